"""Scripted drivers as rows: floor and ceiling of every table, and the calibration's yardstick."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from algorithms.guard_demand import require_horizon
from algorithms.method import Method, Policy, Task
from algorithms.versions import GUARD_VERSION


class ReferenceDriver(Method):
    """A scripted driver as a row of the tables: no T stage.

    Attributes:
        driver: Name in `algorithms.scripted_policies.DRIVERS`.
    """

    version = 1
    trains = False
    defaults: ClassVar[dict[str, Any]] = {}
    driver: ClassVar[str]

    def train(self, task: Task) -> Policy:
        """Nothing to learn."""
        from algorithms.scripted_policies import DRIVERS

        return DRIVERS[self.driver]()

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The driver itself; the folder only names it."""
        return self.train(task)


class ConstantSpeed(ReferenceDriver):
    """Keeps lane and speed."""

    driver = "constant-speed"


class Random(ReferenceDriver):
    """Uniformly random actions."""

    driver = "random"


class IDM(ReferenceDriver):
    """highway-env's car-following model as the ego."""

    driver = "idm"


class Cruise(ReferenceDriver):
    """The careful overtaker of the calibration."""

    driver = "cruise"


class GuardedDriver(Method):
    """A scripted driver behind the safety guard with a fixed T_c.

    Attributes:
        driver: Name in `algorithms.scripted_policies.DRIVERS`.
    """

    version = GUARD_VERSION
    trains = False
    defaults: ClassVar[dict[str, Any]] = {"tc": 3.0}
    driver: ClassVar[str]

    def __init__(self, **parameters: Any) -> None:
        """Check T_c at once."""
        super().__init__(**parameters)
        require_horizon(self.parameters["tc"])

    def train(self, task: Task) -> Policy:
        """Nothing to learn."""
        from algorithms.safety_guard import SafetyGuard
        from algorithms.scripted_policies import DRIVERS

        return DRIVERS[self.driver](SafetyGuard(self.parameters["tc"]))

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The driver itself; the folder only names it."""
        return self.train(task)


class RandomGuarded(GuardedDriver):
    """Uniformly random actions behind the guard: the guard's own worth."""

    driver = "random"


class CruiseGuarded(GuardedDriver):
    """The careful overtaker behind the guard: the ceiling of what can be learnt there."""

    driver = "cruise"


class ConstantSpeedGuarded(GuardedDriver):
    """Lane and speed kept, unless the guard objects."""

    driver = "constant-speed"
