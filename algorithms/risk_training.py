"""Alg. 1: roll the driving agent out in randomised traffic, then clone its T_c with the risk network.

Or, for dd-rq-plus, learn from the same roll-outs how likely contact is within 3 s.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from scipy import special, stats
from torch.nn import functional

from algorithms.artefacts import Making, cached, digest
from algorithms.driving_agent import DrivingAgentSpec, driving_agent
from algorithms.method import Observations, Policy, seed_sequence
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskNetwork
from algorithms.versions import MODEL_VERSION
from envs.driving_env import DrivingVectorEnv
from envs.layout import EpisodeSource
from envs.scenario import STEP_S, Scenario, get_scenario
from envs.world import BoolArray, FloatArray

PLANNING_TIME, CONTACT = "planning time", "contact"
"""What the network learns: the agent's T_c [s] by mean squared error, or the probability of contact within
CONTACT_WITHIN_S by cross-entropy."""
CONTACT_WITHIN_S: Final = 3.0
CONTACT_WITHIN_STEPS: Final = round(CONTACT_WITHIN_S / STEP_S)
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
        label: `PLANNING_TIME` or `CONTACT`.
    """

    samples: int = 300_000
    batch: int = 1024
    epochs: int = 15
    patience: int = 3
    learning_rate: float = 1e-3
    seed: int = 0
    label: str = PLANNING_TIME

    @classmethod
    def for_agent(cls, agent_steps: int, label: str = PLANNING_TIME) -> RiskSettings:
        """The paper's data set; a hundredth of it where the agent is barely trained (smoke runs)."""
        if agent_steps >= FULL_DATA_STEPS:
            return cls(label=label)
        return cls(samples=3_000, batch=256, epochs=2, label=label)


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
    """Pairs of X and label of the deterministic driving agent in randomised traffic, seconds for 300,000."""
    variant = randomised(scenario)
    source = EpisodeSource(variant, seed_sequence("risk data", variant.id, settings.seed))
    env = DrivingVectorEnv(variant, WORLDS, source=source, action_mode=policy.action_mode, comfort=False)
    observations, _ = env.reset()
    kept, times, contacts, ends = [], [], [], []
    ahead = decisions_ahead(variant) if settings.label == CONTACT else 1
    decisions = -(-settings.samples // WORLDS)
    for _ in range(decisions + ahead - 1):
        actions = policy.act(observations)
        kept.append(observations)
        times.append(actions[:, 0].astype(np.float32))
        observations, _, terminated, truncated, info = env.step(actions)
        ends.append(terminated | truncated)
        contacts.append(contact_steps(info, ends[-1], variant.substeps))
    labels = np.array(times[:decisions])
    if settings.label == CONTACT:
        within = contact_within(np.array(contacts), np.array(ends), variant.substeps)
        labels = within[:decisions].astype(np.float32)
    world = np.tile(np.arange(WORLDS), decisions)
    return Samples(
        np.concatenate(kept[:decisions])[: settings.samples],
        labels.reshape(-1)[: settings.samples],
        (world < HELD_OUT_WORLDS)[: settings.samples],
    )


def decisions_ahead(scenario: Scenario) -> int:
    """Decisions that must be known to tell whether contact follows the first of them within CONTACT_WITHIN_S."""
    return -(-CONTACT_WITHIN_STEPS // scenario.substeps)


def contact_steps(info: Mapping[str, Any], ended: BoolArray, substeps: int) -> npt.NDArray[np.int64]:
    """Steps of 0.1 s of the last decision until it ended in contact, 0 where it did not, shape (N,).

    Args:
        info: Of `DrivingVectorEnv.step`.
        ended: Whether the decision ended the episode, shape (N,).
        substeps: Of a decision.
    """
    steps = np.zeros(len(ended), np.int64)
    if ended.any():
        steps[ended] = (info["finished"]["steps"] - 1) % substeps + 1
    return np.where(info["cost"] > 0.0, steps, 0)


def contact_within(contacts: npt.NDArray[np.int64], ends: BoolArray, substeps: int) -> BoolArray:
    """Whether the running episode ends in contact within CONTACT_WITHIN_S of the beginning of a decision.

    Args:
        contacts: `contact_steps` of each decision, shape (T, N).
        ends: Whether it ended the episode, shape (T, N).
        substeps: Steps of 0.1 s of a whole decision.

    Returns:
        Shape (T, N); the last rows look only as far as there are decisions.
    """
    within = np.zeros(contacts.shape, np.bool_)
    left = np.full(contacts.shape[1], np.inf)  # steps from the beginning of a decision until contact
    for t in reversed(range(len(contacts))):
        left = np.where(contacts[t] > 0, contacts[t], np.where(ends[t], np.inf, left + substeps))
        within[t] = left <= CONTACT_WITHIN_STEPS
    return within


def _predict(network: RiskNetwork, x: torch.Tensor) -> torch.Tensor:
    with torch.no_grad():
        return torch.cat([network(part)[0] for part in x.split(8192)])


def fit(
    samples: Samples, settings: RiskSettings, architecture: RiskArchitecture, progress: Callable[[int], None]
) -> tuple[RiskNetwork, dict[str, Any]]:
    """Train the network on its label's loss with early stopping; network and its held-out figures.

    The held-out samples choose the epoch too, so their error is slightly optimistic.

    Raises:
        FloatingPointError: No epoch had a finite held-out error.
    """
    torch.set_num_threads(1)
    generator = torch.Generator().manual_seed(settings.seed)
    with torch.random.fork_rng():
        torch.manual_seed(settings.seed)
        network = RiskNetwork(architecture)
    x, y = torch.from_numpy(samples.observations), torch.from_numpy(samples.labels)
    held_out = torch.from_numpy(samples.held_out)
    x_train, y_train, x_test, y_test = x[~held_out], y[~held_out], x[held_out], y[held_out]
    mean = float(y_train.mean())
    contact = settings.label == CONTACT
    criterion = functional.binary_cross_entropy_with_logits if contact else functional.mse_loss
    with torch.no_grad():
        network.head.bias.fill_(float(special.logit(np.clip(mean, 1e-4, 1.0 - 1e-4))) if contact else mean)
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
    curve: list[dict[str, float]] = []
    best, best_state = float("inf"), network.state_dict()
    for epoch in range(settings.epochs):
        order = torch.randperm(len(x_train), generator=generator)
        total = 0.0
        for index in order.split(settings.batch):
            loss = criterion(network(x_train[index])[0], y_train[index])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            total += float(loss.detach()) * len(index)
        error = float(criterion(_predict(network, x_test), y_test))
        curve.append({"epoch": epoch, "loss_train": total / len(x_train), "loss_held_out": error})
        progress(epoch + 1)
        if error < best:
            best, best_state = error, {k: v.clone() for k, v in network.state_dict().items()}
        elif epoch - min(range(len(curve)), key=lambda k: curve[k]["loss_held_out"]) >= settings.patience:
            break
    if not math.isfinite(best):
        raise FloatingPointError(f"The risk model's held-out error is {error} after every one of {len(curve)} epochs.")
    network.load_state_dict(best_state)
    return network, _figures(network, x_test, y_test, contact) | {"curve": curve}


def _figures(network: RiskNetwork, x: torch.Tensor, y: torch.Tensor, contact: bool) -> dict[str, Any]:
    """Held-out errors, and the distribution that the controls draw from."""
    prediction = _predict(network, x).numpy().astype(np.float64)
    if contact:
        prediction = special.expit(prediction)
    label = y.numpy().astype(np.float64)
    mse = float(np.mean((prediction - label) ** 2))
    varies = min(prediction.std(), label.std()) > 0.0
    figures = {
        "mse_held_out": mse,
        "r2_held_out": 1.0 - mse / max(float(label.var()), 1e-12),
        "spearman_held_out": float(stats.spearmanr(prediction, label).statistic) if varies else None,
        "label_mean": float(label.mean()),
        "label_sd": float(label.std()),
        "value_mean": float(prediction.mean()),
        "value_quantiles": np.quantile(prediction, np.linspace(0.0, 1.0, 201)).round(4).tolist(),
    }
    if contact and 0.0 < label.mean() < 1.0:
        # The probability that a state before contact ranks above one that is not (ROC AUC, Mann-Whitney).
        hits = label > 0.5
        u = stats.mannwhitneyu(prediction[hits], prediction[~hits]).statistic
        figures["auc_held_out"] = float(u / (hits.sum() * (~hits).sum()))
    return figures


def risk_model(
    scenario: Scenario,
    agent_steps: int,
    cache: Path,
    settings: RiskSettings | None = None,
    making: Making = lambda _what, _done, _total: None,
) -> RiskModel:
    """The risk model of a scenario's driving agent, from the cache or trained now.

    With the label `CONTACT` the value that it gives is a logit.

    Args:
        scenario: What it is for.
        agent_steps: Simulation steps that the driving agent is trained for.
        cache: Folder of shared artefacts.
        settings: Of Alg. 1.
        making: Told of the driving agent's training, in simulation steps, and of the model's, in epochs.
    """
    chosen, architecture = settings or RiskSettings.for_agent(agent_steps), RiskArchitecture()
    spec = DrivingAgentSpec(scenario.name, agent_steps)
    identity = {"agent": spec.key, **asdict(chosen), **asdict(architecture), "version": MODEL_VERSION}

    def build(folder: Path) -> None:
        agent = driving_agent(
            spec,
            cache,
            lambda steps, _: making("driving agent", steps, spec.steps),
            lambda: making("waiting for driving agent", 0, 1),
        )
        making("risk model", 0, chosen.epochs)
        samples = collect(agent, scenario, chosen)
        network, figures = fit(
            samples, chosen, architecture, lambda epochs: making("risk model", epochs, chosen.epochs)
        )
        description = {"scenario": scenario.id, "agent": spec.key, "settings": asdict(chosen), **figures}
        RiskModel(network, architecture, description).save(folder)

    folder = cache / f"risk-model-{digest(identity)}"
    return RiskModel.load(cached(folder, build, lambda: making("waiting for risk model", 0, 1)), scenario.id)


def shuffled_values(model: RiskModel, draws: FloatArray) -> FloatArray:
    """Values drawn from the model's own held-out distribution, by uniform draws in [0, 1): time order destroyed."""
    quantiles = np.asarray(model.description["value_quantiles"])
    values: FloatArray = np.interp(draws, np.linspace(0.0, 1.0, len(quantiles)), quantiles)
    return values


def unrelated_draws(observations: Observations, salt: bytes) -> FloatArray:
    """Uniform draws in [0, 1), shape (N,), the same for the same observation and salt, else without relation to it.

    Digests instead of a generator: whoever asks, and how often, changes nothing for those who ask later.
    """
    digests = (hashlib.blake2b(row.tobytes(), digest_size=8, key=salt).digest() for row in observations)
    return np.array([int.from_bytes(digest, "little") for digest in digests], np.float64) / 2.0**64
