"""The checks. Each has a name, and a detail that says what was found and, where it failed, what to do.

What they cannot show: a difference proves that something was used, not that it was used rightly. `TRUNCATION` trains
twice more on the same episodes, once with every truncation called a termination, once with other last observations of
truncated episodes; a learner that bootstraps as it should ends elsewhere both times. One that uses them with a wrong
sign does so, too: that takes a task with a known answer, in the method's own tests.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from algorithms.method import BudgetExceededError, Method
from algorithms.registry import get_method
from bench.contract import probe
from bench.contract.probe import Alter, Drive, Trial
from bench.errors import UsageError
from envs.driving_env import MutatedObservationError
from envs.plugins import UnavailableError
from envs.scenario import Scenario, get_scenario
from envs.world import Ending

SCENARIO: Final = "b"
SUFFIXES: Final = (".safetensors", ".json")

AVAILABLE: Final = "available"
TRAINS: Final = "trains"
BUDGET: Final = "budget kept to the step"
OBSERVATIONS: Final = "observations left alone"
FINITE: Final = "actions finite"
SPACES: Final = "spaces respected"
SHIELD: Final = "shield leaves its arguments alone"
SAVED: Final = "save and load agree"
DETERMINISM: Final = "determinism"
COST: Final = "cost seen"
TRUNCATION: Final = "truncation treated as truncation"
NAMES: Final = (
    AVAILABLE, TRAINS, BUDGET, OBSERVATIONS, FINITE, SPACES, SHIELD, SAVED, DETERMINISM, COST, TRUNCATION,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Check:
    """One finding; the detail says what was found and, where it failed, what to do."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True, slots=True)
class Report:
    """All findings about one method, in the order of `NAMES`."""

    method: str
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    def as_json(self) -> dict[str, Any]:
        """``{"method", "passed", "checks": [{"name", "passed", "detail"}]}``."""
        checks = [dataclasses.asdict(check) for check in self.checks]
        return {"method": self.method, "passed": self.passed, "checks": checks}


def check_method(name: str) -> Report:
    """Run every check on a method.

    Args:
        name: With its parameters, as ``bench run --algo`` takes it.

    Raises:
        UsageError: The name or a parameter is unknown.
    """
    try:
        method = get_method(name)
    except UnavailableError as error:
        return _unreached(name, [], AVAILABLE, str(error))
    except ValueError as error:
        raise UsageError(str(error)) from error
    found = [Check(AVAILABLE, True, f"{type(method).__module__}:{type(method).__qualname__}, version {method.version}")]
    with tempfile.TemporaryDirectory() as folder:
        return _Examination(name, method, get_scenario(SCENARIO), Path(folder)).report(found)


def _unreached(method: str, found: list[Check], fault: str, reason: str) -> Report:
    """A report that ends early: what was not reached has not passed."""
    have = {check.name: check for check in found} | {fault: Check(fault, False, reason)}
    rest = (have.get(name, Check(name, False, f"not reached: {fault}: {reason}")) for name in NAMES)
    return Report(method, tuple(rest))


def _first(faults: list[str], good: str) -> tuple[bool, str]:
    return (False, faults[0]) if faults else (True, good)


def _fault_of(error: Exception) -> str:
    """The check that an error in training belongs to."""
    if isinstance(error, BudgetExceededError):
        return BUDGET
    if isinstance(error, MutatedObservationError):
        return OBSERVATIONS
    return FINITE if isinstance(error, ValueError) and "must be finite" in str(error) else TRAINS


@dataclass(slots=True)
class _Examination:
    """One method under examination."""

    name: str
    method: Method
    scenario: Scenario
    folder: Path

    def report(self, found: list[Check]) -> Report:
        try:
            first = self._trial("first")
        except Exception as error:  # a plugin may raise anything: that is the finding
            reason = f"{type(error).__name__}: {error}"
            return _unreached(self.name, found, _fault_of(error), reason)
        found.append(Check(TRAINS, True, f"{len(first.files)} files, {len(first.episodes)} finished episodes"))
        for name, passed, detail in self._findings(first):
            found.append(Check(name, passed, detail))
        return Report(self.name, tuple(sorted(found, key=lambda check: NAMES.index(check.name))))

    def _findings(self, first: Trial) -> Iterator[tuple[str, bool, str]]:
        yield BUDGET, *self._budget(first)
        seen = Drive()
        try:
            probe.drive(first.policy, self.scenario, seen)
        except Exception as error:
            seen.outside.insert(0, f"driving failed: {type(error).__name__}: {error}")
        yield OBSERVATIONS, *_first(seen.written, "neither training nor act() wrote into observations")
        yield FINITE, *_first(seen.infinite, f"{len(seen.actions)} calls of act(), extreme observations among them")
        yield SPACES, *_first(seen.outside, "shapes and bounds of actions, for 1, 3 and 16 worlds")
        guarded = "no argument changed" if first.policy.shield is not None else "no shield"
        yield SHIELD, *_first(seen.shield, guarded)
        checks: dict[str, Callable[[], tuple[bool, str]]] = {
            SAVED: lambda: self._saved(first, seen),
            DETERMINISM: lambda: self._determinism(first, seen),
            COST: lambda: self._cost(first),
            TRUNCATION: lambda: self._truncation(first),
        }
        for name, check in checks.items():
            try:
                yield name, *check()
            except Exception as error:
                yield name, False, f"{type(error).__name__}: {error}"

    def _trial(self, cache: str, alter: Alter | None = None) -> Trial:
        return probe.trial(get_method(self.name), self.scenario, self.folder / cache, alter)

    def _budget(self, first: Trial) -> tuple[bool, str]:
        due = probe.STEPS if self.method.trains else 0
        detail = f"{first.steps:,} of {due:,} simulation steps"
        if first.steps == due:
            return True, detail
        return False, f"{detail}: step the environment of task.make_env until its decision_limit, no more and no less"

    def _saved(self, first: Trial, seen: Drive) -> tuple[bool, str]:
        foreign = [name for name in first.files if not name.endswith(SUFFIXES)]
        if foreign:
            return False, f"save() wrote {foreign[0]}: weights go into .safetensors, the rest into .json, never pickle"
        folder = self.folder / "saved"
        for name, content in first.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        folder.mkdir(exist_ok=True)
        loaded = get_method(self.name).load_policy(folder, probe.task_for(self.scenario, self.folder / "first"))
        again = Drive()
        probe.drive(loaded, self.scenario, again)
        return _same_drive(seen, again, "the loaded policy", "save everything that act() and the shield depend on")

    def _determinism(self, first: Trial, seen: Drive) -> tuple[bool, str]:
        again = Drive()
        probe.drive(first.policy, self.scenario, again)
        good, detail = _same_drive(seen, again, "a second drive", "seed what draws numbers in begin()")
        if not good:
            return good, detail
        second = self._trial("second")
        differing = [
            name for name in {**first.files, **second.files} if first.files.get(name) != second.files.get(name)
        ]
        if first.episodes.tobytes() != second.episodes.tobytes():
            differing.append("the training episodes")
        if differing:
            return False, f"{differing[0]} differs in a second training: take every seed from task.stream or torch_seed"
        return True, f"trained twice: {len(first.files)} files and {len(first.episodes)} episodes, byte for byte"

    def _cost(self, first: Trial) -> tuple[bool, str]:
        hits = int((first.episodes["ending"] == Ending.COLLISION).sum())
        detail = f"{hits} of {len(first.episodes)} training episodes cost 1, counted by the environment"
        if not (self.method.trains and self.method.bounds_cost):
            return True, f"{detail}; the method does not bound it" if self.method.trains else "does not train"
        if self._trial("first", probe.charge_every_step).files == first.files:
            return False, "a cost of 1 in every step changed nothing: read info['cost'], or set bounds_cost = False"
        return True, f"{detail}; a cost of 1 in every step changes what is learnt"

    def _truncation(self, first: Trial) -> tuple[bool, str]:
        if not self.method.trains:
            return True, "does not train"
        if not self.method.bootstraps:
            return True, "declares that it uses no value of a next state (bootstraps = False)"
        if not first.truncations:
            return False, "no episode was truncated in training: step the environment of task.make_env"
        if self._trial("first", probe.call_truncations_terminations).files == first.files:
            return False, (
                "calling every truncation a termination changed nothing: bootstrap where truncated, not where "
                "terminated, or set bootstraps = False where no value of a next state is used"
            )
        if self._trial("first", probe.forge_final_observations).files == first.files:
            return False, (
                "another info['final_obs'] changed nothing: at a truncation the next state is final_obs; "
                "the observation that step() returns is the next episode's first"
            )
        return True, f"{first.truncations} truncations; their flag and their last observation change what is learnt"


def _same_drive(one: Drive, other: Drive, what: str, remedy: str) -> tuple[bool, str]:
    for k, (a, b) in enumerate(zip(one.actions, other.actions, strict=True)):
        if not np.array_equal(a, b, equal_nan=True):
            return False, f"{what} gave other actions at decision {k}: {remedy}"
    if one.states != other.states:
        return False, f"{what} led to other states behind its shield: {remedy}"
    return True, f"{len(one.actions)} calls of act() and {len(one.states)} states, bit for bit"
