"""Scripted drivers as rows: floor and ceiling of every table, and the calibration's yardstick."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from algorithms.guard_demand import require_horizon
from algorithms.method import Method, Policy, Task
from algorithms.safety_guard import GUARD_VERSION, SafetyGuard
from algorithms.scripted_policies import ConstantSpeedPolicy, CruisePolicy, IDMPolicy, RandomPolicy, ScriptedPolicy


class ReferenceDriver(Method):
    """A scripted driver as a row of the tables: no T stage."""

    version = 1
    trains = False
    defaults: ClassVar[dict[str, Any]] = {}
    policy: ClassVar[type[ScriptedPolicy]]

    def train(self, task: Task) -> Policy:
        """Nothing to learn."""
        return self.policy()

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The driver itself; the folder only names it."""
        return self.policy()


class ConstantSpeed(ReferenceDriver):
    """Keeps lane and speed."""

    policy = ConstantSpeedPolicy


class Random(ReferenceDriver):
    """Uniformly random actions."""

    policy = RandomPolicy


class IDM(ReferenceDriver):
    """highway-env's car-following model as the ego."""

    policy = IDMPolicy


class Cruise(ReferenceDriver):
    """The careful overtaker of the calibration."""

    policy = CruisePolicy


class GuardedDriver(Method):
    """A scripted driver behind the safety guard with a fixed T_c."""

    version = GUARD_VERSION
    trains = False
    defaults: ClassVar[dict[str, Any]] = {"tc": 3.0}
    policy: ClassVar[type[ScriptedPolicy]]

    def __init__(self, **parameters: Any) -> None:
        """Check T_c at once."""
        super().__init__(**parameters)
        require_horizon(self.parameters["tc"])

    def train(self, task: Task) -> Policy:
        """Nothing to learn."""
        return self.policy(SafetyGuard(self.parameters["tc"]))

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The driver itself; the folder only names it."""
        return self.train(task)


class RandomGuarded(GuardedDriver):
    """Uniformly random actions behind the guard: the guard's own worth."""

    policy = RandomPolicy


class CruiseGuarded(GuardedDriver):
    """The careful overtaker behind the guard: the ceiling of what can be learnt there."""

    policy = CruisePolicy


class ConstantSpeedGuarded(GuardedDriver):
    """Lane and speed kept, unless the guard objects."""

    policy = ConstantSpeedPolicy
