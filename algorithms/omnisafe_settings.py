"""Settings of the OmniSafe baselines, in one place, each with its reason; docs/baseline-tuning.md has the figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any, Final

from algorithms.sac import ACTOR_LAYERS, CRITIC_LAYERS

ACTIVATION: Final = "relu"
"""As for the other methods; OmniSafe's tanh takes twenty times as long on a CPU."""


@dataclass(frozen=True, slots=True)
class OmniSafeSettings:
    """What may be set from outside; the rest of OmniSafe's settings are its own defaults.

    Attributes:
        worlds: Worlds stepped together, at most; the largest number that divides the budget is taken.
        epoch_decisions: Decisions between two updates, over all worlds; fewer where the budget is small, more where
            the longest episode needs it.
        least_epochs: A small budget is cut into so many epochs, as far as the longest episode allows.
        batch: Mini-batch of the critics, and of the actor in first-order algorithms.
        iterations: Passes over an epoch's decisions.
        critic_learning_rate: Adam's, of both critics.
        actor_learning_rate: Adam's; first-order algorithms only.
        critic_decay: Weight of the squared weights in the critics' loss; OmniSafe's 0.001 outweighs a rare cost of 1.
        kl_limit: Trust region of second-order algorithms; early stop of first-order ones.
        fisher_decisions: Decisions of an epoch, evenly spaced, that Fisher products use; the line search still
            measures KL on all of them.
        fisher_iterations: Conjugate-gradient iterations.
        fisher_damping: Added to the Fisher matrix's diagonal; OmniSafe's 0.1 outweighs the curvature of our networks,
            and a step then stays far inside the trust region.
        multiplier: Lagrange multiplier at the start.
        multiplier_learning_rate: Adam's, of the multiplier, one step per epoch.
        multiplier_max: Cap of the multiplier, where the algorithm has one (FOCOPS, CUP).
        temperature: FOCOPS' lambda.
        noise_first: Standard deviation of exploration after the first epoch, of half the action's range; 0 learns it.
        noise_last: The same after the last epoch; linear in between.
        gae: Decay of advantage estimates of reward and cost.
    """

    worlds: int = 20
    epoch_decisions: int = 4000
    least_epochs: int = 10
    batch: int = 500
    iterations: int = 3
    critic_learning_rate: float = 1e-3
    actor_learning_rate: float = 3e-4
    critic_decay: float = 0.0
    kl_limit: float = 0.01
    fisher_decisions: int = 100
    fisher_iterations: int = 10
    fisher_damping: float = 0.1
    multiplier: float = 0.001
    multiplier_learning_rate: float = 0.035
    multiplier_max: float = 2.0
    temperature: float = 1.5
    noise_first: float = 0.5
    noise_last: float = 0.2
    gae: float = 0.95

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        for item in fields(self):
            value = getattr(self, item.name)
            least = 1 if isinstance(item.default, int) else 0
            if not value >= least:
                raise ValueError(f"{item.name} = {value}: must be at least {least}.")

    def with_changes(self, changes: Mapping[str, str]) -> OmniSafeSettings:
        """These settings with ``--set`` values over them.

        Raises:
            ValueError: A value is malformed or out of range.
        """
        parsed: dict[str, Any] = {}
        for item in fields(self):
            if item.name in changes:
                kind: type[Any] = type(getattr(self, item.name))
                try:
                    parsed[item.name] = kind(changes[item.name])
                except ValueError:
                    raise ValueError(f"{item.name} = {changes[item.name]!r}: expected {kind.__name__}.") from None
        return replace(self, **parsed)


SETTING_NAMES: Final = tuple(item.name for item in fields(OmniSafeSettings))

# TRPO-Lag's multiplier starts high: once every policy near the present one crashes, it does not find the way back.
_TUNED: Final[Mapping[str, OmniSafeSettings]] = MappingProxyType(
    {
        "FOCOPS": OmniSafeSettings(
            actor_learning_rate=1e-3,
            kl_limit=0.1,
            temperature=0.5,
            multiplier=20.0,
            multiplier_learning_rate=1.0,
            multiplier_max=100.0,
            epoch_decisions=1000,
        ),
        "TRPOLag": OmniSafeSettings(
            kl_limit=0.03, multiplier=100.0, multiplier_learning_rate=5.0, epoch_decisions=1000
        ),
    }
)


def settings_of(algorithm: str) -> OmniSafeSettings:
    """Tuned settings of an algorithm, or the common ones."""
    return _TUNED.get(algorithm, OmniSafeSettings())


@dataclass(frozen=True, slots=True)
class Schedule:
    """How a budget is spent: epochs x steps x worlds decisions, and a rest that no update can use.

    Attributes:
        worlds: Worlds stepped together.
        epochs: Roll-outs, each followed by an update.
        steps: Decisions of each world in an epoch, not fewer than the longest episode: each epoch then sees an
            episode end, and its mean cost is a number.
        rest: Decisions of each world after the last update.
    """

    worlds: int
    epochs: int
    steps: int
    rest: int


def plan(decisions: int, longest_episode: int, settings: OmniSafeSettings) -> Schedule:
    """Spend a budget exactly, with epochs near the wanted size.

    Args:
        decisions: The budget.
        longest_episode: Decisions until an episode ends at the latest.
        settings: Wanted worlds and epochs.

    Raises:
        ValueError: The budget is shorter than the longest episode.
    """
    if decisions < longest_episode:
        raise ValueError(
            f"A budget of {decisions} decisions is too small: on-policy training needs at least the longest "
            f"episode, {longest_episode} decisions."
        )
    size = min(settings.epoch_decisions, decisions // settings.least_epochs)
    fitting = (n for n in range(1, settings.worlds + 1) if decisions % n == 0 and n * longest_episode <= size)
    worlds = max(fitting, default=1)
    each = decisions // worlds
    wanted = max(1, round(each / max(size // worlds, longest_episode)))
    most = min(each // longest_episode, math.ceil(1.25 * wanted))
    epochs = min(range(max(1, math.floor(0.75 * wanted)), most + 1), key=lambda n: (each % n, abs(n - wanted)))
    return Schedule(worlds, epochs, each // epochs, each % epochs)


def configuration(
    algorithm_defaults: Mapping[str, Any],
    settings: OmniSafeSettings,
    schedule: Schedule,
    *,
    cost_limit: float,
    gamma: float,
    seed: int,
) -> dict[str, Any]:
    """OmniSafe's custom configuration: our values for those keys that the algorithm has.

    `cost_limit` goes into every section that has the key: `algo_cfgs` of CPO and its kin, `lagrange_cfgs` of the
    Lagrangian algorithms. Keys with the value None are left out: one of them would end OmniSafe's validation.

    Args:
        algorithm_defaults: Sections of the algorithm's own configuration.
        settings: Ours.
        schedule: Worlds and epochs.
        cost_limit: Bound on the undiscounted episode cost.
        gamma: Discount per decision, of reward and cost.
        seed: For networks and exploration, 32 bits.
    """
    size = schedule.worlds * schedule.steps
    wanted: dict[str, dict[str, Any]] = {
        "train_cfgs": {
            "device": "cpu",
            "torch_threads": 1,
            "parallel": 1,
            "vector_env_nums": schedule.worlds,
            "total_steps": schedule.epochs * size,
        },
        "logger_cfgs": {"use_wandb": False, "use_tensorboard": False, "save_model_freq": 10**9},
        "algo_cfgs": {
            **_algorithm_section(settings, cost_limit, gamma),
            "steps_per_epoch": size,
            "fvp_sample_freq": max(1, size // settings.fisher_decisions),
        },
        "lagrange_cfgs": {
            "cost_limit": cost_limit,
            "lagrangian_multiplier_init": settings.multiplier,
            "lambda_lr": settings.multiplier_learning_rate,
            "lagrangian_upper_bound": settings.multiplier_max,
        },
        "model_cfgs": {
            "exploration_noise_anneal": settings.noise_first > 0.0,
            "std_range": [settings.noise_first, settings.noise_last],
            "actor": _network(ACTOR_LAYERS, settings.actor_learning_rate),
            "critic": _network(CRITIC_LAYERS, settings.critic_learning_rate),
        },
    }
    known = {key: _known(wanted[key], section) for key, section in algorithm_defaults.items() if key in wanted}
    return {"seed": seed, **known}


def _algorithm_section(settings: OmniSafeSettings, cost_limit: float, gamma: float) -> dict[str, Any]:
    return {
        "update_iters": settings.iterations,
        "batch_size": settings.batch,
        "target_kl": settings.kl_limit,
        "focops_eta": settings.kl_limit,
        "focops_lam": settings.temperature,
        "obs_normalize": False,  # the state is scaled, and theirs would go on moving in application
        "reward_normalize": False,
        "cost_normalize": False,  # would hide the cost carried over an epoch's start
        "use_critic_norm": settings.critic_decay > 0.0,
        "critic_norm_coef": settings.critic_decay,
        "gamma": gamma,
        "cost_gamma": gamma,  # their buffer reads only `gamma`, for both
        "lam": settings.gae,
        "lam_c": settings.gae,
        "cg_iters": settings.fisher_iterations,
        "cg_damping": settings.fisher_damping,
        "cost_limit": cost_limit,
        "distance": 0.0,  # OnCRPO's tolerance; its 2.0 could never bind on a cost of at most 1
    }


def _network(layers: tuple[int, ...], learning_rate: float) -> dict[str, Any]:
    return {"hidden_sizes": list(layers), "activation": ACTIVATION, "lr": learning_rate}


def _known(wanted: Mapping[str, Any], section: Mapping[str, Any]) -> dict[str, Any]:
    """The wanted values of keys that the section has and uses: a learning rate of None stays None."""
    chosen: dict[str, Any] = {}
    for key, value in wanted.items():
        if key not in section or (key == "lr" and section[key] is None):
            continue
        chosen[key] = _known(value, section[key]) if isinstance(value, dict) else value
    return chosen
