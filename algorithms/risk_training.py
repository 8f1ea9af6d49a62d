"""Alg. 1: roll the driving agent out in randomised traffic, then clone its T_c with the risk network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from scipy import stats
from torch.nn import functional

from algorithms.artefacts import cached, digest
from algorithms.driving_agent import DrivingAgentSpec, driving_agent
from algorithms.method import Policy, seed_sequence
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskNetwork
from envs.driving_env import DrivingVectorEnv
from envs.layout import EpisodeSource
from envs.scenario import Scenario, get_scenario
from envs.world import FloatArray

VERSION: Final = 1
"""Raised by every change that alters the trained model."""
WORLDS: Final = 256
HELD_OUT_WORLDS: Final = 26
"""Worlds whose samples are held out: a tenth, whole episodes, so that neighbours in time do not leak."""
FULL_DATA_STEPS: Final = 50_000
"""Below this budget of the driving agent the data set is a token one."""


@dataclass(frozen=True, slots=True)
class RiskSettings:
    """Data set and training of Alg. 1.

    Attributes:
        samples: n_DA, size of the data set (paper, appendix).
        batch: n_b.
        epochs: n_epoch, at most.
        patience: Epochs without a better held-out error before training stops.
        learning_rate: Adam's.
        seed: Of data set, initial weights and batches.
    """

    samples: int = 300_000
    batch: int = 1024
    epochs: int = 15
    patience: int = 3
    learning_rate: float = 1e-3
    seed: int = 0

    @classmethod
    def for_agent(cls, agent_steps: int) -> RiskSettings:
        """The paper's data set; a hundredth of it where the agent is barely trained (smoke runs)."""
        return cls() if agent_steps >= FULL_DATA_STEPS else cls(samples=3_000, batch=256, epochs=2)


@dataclass(frozen=True, slots=True)
class Samples:
    """A data set.

    Attributes:
        observations: Shape (M, 47).
        labels: Shape (M,).
        held_out: Shape (M,).
    """

    observations: npt.NDArray[np.float32]
    labels: npt.NDArray[np.float32]
    held_out: npt.NDArray[np.bool_]


def randomised(scenario: Scenario) -> Scenario:
    """The scenario with traffic parameters drawn anew in every episode."""
    separator = "," if ":" in scenario.name else ":"
    return get_scenario(f"{scenario.name}{separator}randomised_traffic=true")


def collect(policy: Policy, scenario: Scenario, settings: RiskSettings) -> Samples:
    """Pairs (X, T_c) of the deterministic driving agent in randomised traffic, seconds for 300,000."""
    variant = randomised(scenario)
    source = EpisodeSource(variant, seed_sequence("risk data", variant.id, settings.seed))
    env = DrivingVectorEnv(variant, WORLDS, source=source, action_mode=policy.action_mode, comfort=False)
    observations, _ = env.reset()
    kept, labels = [], []
    for _ in range(-(-settings.samples // WORLDS)):
        actions = policy.act(observations)
        kept.append(observations)
        labels.append(actions[:, 0].astype(np.float32))
        observations, *_ = env.step(actions)
    world = np.tile(np.arange(WORLDS), len(kept))
    return Samples(
        np.concatenate(kept)[: settings.samples],
        np.concatenate(labels)[: settings.samples],
        (world < HELD_OUT_WORLDS)[: settings.samples],
    )


def _predict(network: RiskNetwork, x: torch.Tensor) -> torch.Tensor:
    with torch.no_grad():
        return torch.cat([network(part)[0] for part in x.split(8192)])


def fit(
    samples: Samples, settings: RiskSettings, architecture: RiskArchitecture, progress: Callable[[str], None]
) -> tuple[RiskNetwork, dict[str, Any]]:
    """Train the network by mean squared error with early stopping; network and its held-out figures."""
    torch.set_num_threads(1)
    generator = torch.Generator().manual_seed(settings.seed)
    with torch.random.fork_rng():
        torch.manual_seed(settings.seed)
        network = RiskNetwork(architecture)
    x, y = torch.from_numpy(samples.observations), torch.from_numpy(samples.labels)
    held_out = torch.from_numpy(samples.held_out)
    x_train, y_train, x_test, y_test = x[~held_out], y[~held_out], x[held_out], y[held_out]
    with torch.no_grad():
        network.head.bias.fill_(float(y_train.mean()))
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
    curve: list[dict[str, float]] = []
    best, best_state = float("inf"), network.state_dict()
    for epoch in range(settings.epochs):
        order = torch.randperm(len(x_train), generator=generator)
        total = 0.0
        for index in order.split(settings.batch):
            loss = functional.mse_loss(network(x_train[index])[0], y_train[index])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            total += float(loss.detach()) * len(index)
        error = float(functional.mse_loss(_predict(network, x_test), y_test))
        curve.append({"epoch": epoch, "mse_train": total / len(x_train), "mse_held_out": error})
        progress(f"epoch {epoch}: held-out MSE {error:.4f} s2")
        if error < best:
            best, best_state = error, {k: v.clone() for k, v in network.state_dict().items()}
        elif epoch - min(range(len(curve)), key=lambda k: curve[k]["mse_held_out"]) >= settings.patience:
            break
    network.load_state_dict(best_state)
    return network, _figures(network, x_test, y_test) | {"curve": curve}


def _figures(network: RiskNetwork, x: torch.Tensor, y: torch.Tensor) -> dict[str, Any]:
    """Held-out error, and the distribution that the controls draw from."""
    prediction = _predict(network, x).numpy().astype(np.float64)
    label = y.numpy().astype(np.float64)
    mse = float(np.mean((prediction - label) ** 2))
    return {
        "mse_held_out": mse,
        "r2_held_out": 1.0 - mse / max(float(label.var()), 1e-12),
        "spearman_held_out": float(stats.spearmanr(prediction, label).statistic),
        "label_mean": float(label.mean()),
        "label_sd": float(label.std()),
        "value_mean": float(prediction.mean()),
        "value_quantiles": np.quantile(prediction, np.linspace(0.0, 1.0, 201)).round(4).tolist(),
    }


def risk_model(
    scenario: Scenario,
    agent_steps: int,
    cache: Path,
    settings: RiskSettings | None = None,
    progress: Callable[[int, Mapping[str, float]], None] | None = None,
    say: Callable[[str], None] = lambda _text: None,
) -> RiskModel:
    """The risk model of a scenario's driving agent, from the cache or trained now.

    Args:
        scenario: What it is for.
        agent_steps: Simulation steps that the driving agent is trained for.
        cache: Folder of shared artefacts.
        settings: Of Alg. 1.
        progress: Of the driving agent's training.
        say: Told of each epoch.
    """
    chosen, architecture = settings or RiskSettings.for_agent(agent_steps), RiskArchitecture()
    spec = DrivingAgentSpec(scenario.name, agent_steps)
    identity = {"agent": spec.key, **asdict(chosen), **asdict(architecture), "version": VERSION}

    def build(folder: Path) -> None:
        agent = driving_agent(spec, cache, progress)
        network, figures = fit(collect(agent, scenario, chosen), chosen, architecture, say)
        description = {"scenario": scenario.id, "agent": spec.key, "settings": asdict(chosen), **figures}
        RiskModel(network, architecture, description).save(folder)

    return RiskModel.load(cached(cache / f"risk-model-{digest(identity)}", build), scenario.id)


def shuffled_values(model: RiskModel, draws: FloatArray) -> FloatArray:
    """Values drawn from the model's own held-out distribution, by uniform draws in [0, 1): time order destroyed."""
    quantiles = np.asarray(model.description["value_quantiles"])
    values: FloatArray = np.interp(draws, np.linspace(0.0, 1.0, len(quantiles)), quantiles)
    return values
