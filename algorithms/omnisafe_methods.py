"""CPO, FOCOPS, TRPO-Lag and the other on-policy algorithms of OmniSafe 0.5.0, on our scenarios."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from algorithms.method import Method, Policy, Task
from algorithms.networks import Architecture, NetworkPolicy
from algorithms.omnisafe_library import algorithm_defaults, require_omnisafe
from algorithms.omnisafe_settings import (
    ACTIVATION,
    SETTING_NAMES,
    configuration,
    plan,
    settings_of,
)
from algorithms.omnisafe_training import train_actor
from algorithms.sac import ACTOR_LAYERS, GAMMA_PER_STEP, training_scalars
from envs.driving_env import action_space
from envs.observation import OBSERVATION_SIZE
from envs.scenario import STEP_S, TIME_LIMIT_S, Scenario, UnknownNameError

ALGORITHMS: Final = (
    "CPO", "CPPOPID", "CUP", "FOCOPS", "IPO", "NaturalPG", "OnCRPO", "P3O", "PCPO", "PDO", "PPO", "PPOLag",
    "PolicyGradient", "RCPO", "TRPO", "TRPOLag", "TRPOPID",
)  # fmt: skip
"""OmniSafe's on-policy algorithms but for Saute, Simmer and EarlyTerminated: those change observation or episode."""

UNCONSTRAINED: Final = ("NaturalPG", "PPO", "PolicyGradient", "TRPO")


def longest_episode(scenario: Scenario) -> int:
    """Decisions until an episode ends at the latest."""
    return math.ceil(TIME_LIMIT_S / (STEP_S * scenario.substeps) - 1e-9)


def train(algorithm: str, task: Task) -> NetworkPolicy:
    """Train within the task's budget and return the deterministic policy.

    Raises:
        UnavailableMethodError: OmniSafe cannot be imported.
        ValueError: The budget is shorter than the longest episode, or a setting is malformed.
    """
    settings = settings_of(algorithm).with_changes(task.settings)
    chosen = plan(task.budget.decisions(task.scenario), longest_episode(task.scenario), settings)
    custom = configuration(
        algorithm_defaults(algorithm),
        settings,
        chosen,
        cost_limit=task.cost_limit,
        gamma=GAMMA_PER_STEP**task.scenario.substeps,
        seed=task.torch_seed(),
    )
    env = task.make_env(chosen.worlds)

    def progress(scalars: Mapping[str, float]) -> None:
        task.progress(env.steps_done, {**training_scalars(env), **scalars})

    trained = train_actor(algorithm, env, custom, chosen.rest, progress, task.checkpoints)
    architecture = Architecture(
        (OBSERVATION_SIZE, *ACTOR_LAYERS, action_space(env.action_mode).shape[0]), ACTIVATION, squashed=False
    )
    return NetworkPolicy(architecture, trained)


class OnPolicyMethod(Method):
    """What the methods here share.

    Attributes:
        algorithm: Name in OmniSafe.
    """

    version = 2
    setting_names = SETTING_NAMES
    bounds_cost = True
    algorithm: str

    @classmethod
    def check_available(cls) -> None:
        """Raise `algorithms.registry.UnavailableMethodError` where OmniSafe is not installed."""
        require_omnisafe()

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the algorithm cannot use."""
        settings_of(self.algorithm).with_changes(settings)

    def train(self, task: Task) -> Policy:
        """Train on the environment's reward under its cost contract."""
        return train(self.algorithm, task)

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor."""
        return NetworkPolicy.load(folder)


class CPO(OnPolicyMethod):
    """Constrained policy optimization (Achiam et al. 2017)."""

    algorithm = "CPO"


class FOCOPS(OnPolicyMethod):
    """First-order constrained optimization in policy space (Zhang et al. 2020)."""

    version = 3
    algorithm = "FOCOPS"


class TRPOLag(OnPolicyMethod):
    """Trust-region policy optimization with a Lagrange multiplier (Ray et al. 2019)."""

    version = 4
    algorithm = "TRPOLag"


class OmniSafe(OnPolicyMethod):
    """Any on-policy algorithm of OmniSafe: ``omnisafe:algo=PCPO``."""

    version = 3
    defaults: ClassVar[dict[str, Any]] = {"algo": "PCPO"}

    def __init__(self, **parameters: Any) -> None:
        """Take parameters over the defaults.

        Raises:
            UnknownNameError: OmniSafe has no such algorithm, or it cannot run on our scenarios.
        """
        super().__init__(**parameters)
        self.algorithm = str(self.parameters["algo"])
        if self.algorithm not in ALGORITHMS:
            raise UnknownNameError("OmniSafe algorithm", self.algorithm, list(ALGORITHMS))
        self.bounds_cost = self.algorithm not in UNCONSTRAINED
