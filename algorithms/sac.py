"""Soft actor-critic: the method and its settings; `algorithms.sac_training` trains it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Final

from algorithms.method import Method, Policy, Task
from algorithms.versions import LEARNER_VERSION

ACTOR_LAYERS: Final = (256, 256, 256, 256)
CRITIC_LAYERS: Final = (256, 256, 256)
"""Hidden layers (paper, appendix)."""
GAMMA_PER_STEP: Final = 0.99
"""Discount per 0.1 s (paper, appendix); per decision it is raised to the number of steps."""
LEARNERS: Final = ("fast", "bf16", "sb3")
"""Names of `algorithms.sac_training.LEARNER_CLASSES`."""


@dataclass(frozen=True, slots=True)
class SACSettings:
    """Settings of the learner, the same for every method that is SAC inside.

    Attributes:
        worlds: Worlds stepped together.
        decisions_per_update: Inverse update-to-data ratio; docs/performance.md has the evidence for it and for batch.
        batch: Transitions per update.
        warm_up: Decisions under uniformly random actions before learning starts.
        learning_rate: Adam's, of actor, critics and temperature (paper, appendix).
        tau: Target network step (paper, appendix).
        learner: ``fast``; ``sb3`` for the stock update (the same numbers, slower); ``bf16`` for bfloat16 products.
    """

    worlds: int = 16
    decisions_per_update: int = 4
    batch: int = 64
    warm_up: int = 1600
    learning_rate: float = 3e-4
    tau: float = 5e-3
    learner: str = "fast"

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        for name, least in (("worlds", 1), ("decisions_per_update", 1), ("batch", 1), ("warm_up", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} = {getattr(self, name)}: must be at least {least}.")
        if not 0.0 < self.learning_rate < math.inf:
            raise ValueError(f"learning_rate = {self.learning_rate}: must be positive and finite.")
        if not 0.0 < self.tau <= 1.0:
            raise ValueError(f"tau = {self.tau}: must be above 0 and at most 1.")
        if self.learner not in LEARNERS:
            raise ValueError(f"learner = {self.learner!r}: must be one of {', '.join(LEARNERS)}.")
        if self.worlds % self.decisions_per_update and self.decisions_per_update % self.worlds:
            raise ValueError(
                f"decisions_per_update = {self.decisions_per_update}: must divide worlds = {self.worlds} or be a "
                "multiple of it."
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, str]) -> SACSettings:
        """Defaults with ``--set`` values over them.

        Raises:
            ValueError: A value is malformed.
        """
        changes: dict[str, Any] = {}
        for item in fields(cls):
            if item.name in settings:
                kind: Any = type(item.default)
                try:
                    changes[item.name] = kind(settings[item.name])
                except ValueError:
                    raise ValueError(f"{item.name} = {settings[item.name]!r}: expected {kind.__name__}.") from None
        return replace(cls(), **changes)

    @classmethod
    def for_task(cls, task: Task) -> SACSettings:
        """Settings of a task, held against its budget: an update comes after a whole roll-out.

        Raises:
            ValueError: A value is malformed, or the last roll-out would go beyond the budget.
        """
        chosen, steps = cls.from_settings(task.settings), task.budget.steps
        every = chosen.decisions_per_update
        if every > chosen.worlds and task.budget.decisions(task.scenario) % every:
            unit = every * task.scenario.substeps
            near = max(1, round(steps / unit)) * unit
            raise ValueError(
                f"steps = {steps} with decisions_per_update = {every}: must be a multiple of {unit}; nearest: {near}. "
                f"Or take decisions_per_update = {chosen.worlds}, one update for every decision of the worlds."
            )
        return chosen


SETTING_NAMES: Final = tuple(item.name for item in fields(SACSettings))


class SAC(Method):
    """Plain SAC without a guard, the model-free baseline."""

    version = LEARNER_VERSION
    defaults: ClassVar[dict[str, Any]] = {}
    setting_names = SETTING_NAMES

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the learner cannot use."""
        SACSettings.from_settings(settings)

    def train(self, task: Task) -> Policy:
        """Train on the environment's reward."""
        from algorithms.sac_training import train_sac

        return train_sac(task)

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor."""
        from algorithms.networks import NetworkPolicy

        return NetworkPolicy.load(folder)
