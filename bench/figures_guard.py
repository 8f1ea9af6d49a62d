"""What docs/guard.md shows: the stress cases on record, their tables, and when a shorter T_c tightens."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from algorithms.guard_options import GuardOptions
from algorithms.safety_guard import GUARD_VERSION
from bench.atomic import write_file
from bench.stress import FULL_THROTTLE_LANE_CHANGE, RANDOM, stress_guard
from envs.scenario import get_scenario

DEFAULTS: Final = GuardOptions()


@dataclass(frozen=True, slots=True)
class StressCase:
    """Settings of one call of `stress_guard`."""

    scenario: str
    tc: float
    driver: str = RANDOM
    episodes: int = 20_000
    options: GuardOptions = DEFAULTS
    seed: int = 0

    @property
    def settings(self) -> dict[str, Any]:
        """As in the result, with the versions of scenario and guard."""
        return {
            "scenario": get_scenario(self.scenario).id,
            "tc": self.tc,
            "driver": self.driver,
            "episodes": self.episodes,
            "seed": self.seed,
            "options": dataclasses.asdict(self.options),
            "guard_version": GUARD_VERSION,
        }


_PRINTED: Final = GuardOptions(True, True, True, True, False, False, False, False)
_ABLATION: Final = (
    DEFAULTS,
    GuardOptions(reserve=False),
    GuardOptions(hold=False),
    GuardOptions(turned_body=False),
    GuardOptions(excursion=False),
    GuardOptions(literal_all_lanes=True),
    GuardOptions(literal_followers=True),
    GuardOptions(literal_selection=True),
    GuardOptions(literal_longitudinal=True),
    dataclasses.replace(_PRINTED, literal_all_lanes=False),
    _PRINTED,
)
_VARIANTS: Final = (
    ("a", FULL_THROTTLE_LANE_CHANGE), ("b", FULL_THROTTLE_LANE_CHANGE),
    ("a-dense", RANDOM), ("a-mobil", RANDOM), ("a-dense-mobil", RANDOM), ("b-late", RANDOM),
)  # fmt: skip
CASES: Final[dict[str, tuple[StressCase, ...]]] = {
    "random-actions": tuple(
        StressCase(scenario, tc, episodes=100_000) for scenario in "ab" for tc in (0.5, 1.0, 3.0, 5.0, 7.0)
    ),
    "variants": tuple(StressCase(scenario, tc, driver) for scenario, driver in _VARIANTS for tc in (1.0, 3.0)),
    "ablation": tuple(StressCase("b", tc, options=options) for options in _ABLATION for tc in (3.0, 7.0)),
}
"""What docs/guard.md reports; each set has a file of its own among the records."""


def read_records(path: Path) -> list[dict[str, Any]]:
    """Results of a file of JSON lines, none where there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def record_cases(folder: Path, names: Iterable[str] = tuple(CASES)) -> Iterator[dict[str, Any]]:
    """Run what is missing among the records of `CASES`, and yield each new one.

    Args:
        folder: Holds one file of JSON lines for each set; records of other settings or versions are dropped.
        names: Sets to bring up to date.
    """
    for name in names:
        path = folder / f"{name}.json"
        known = read_records(path)
        records: list[dict[str, Any]] = []
        for case in CASES[name]:
            wanted = case.settings
            found = next((r for r in known if wanted.items() <= r.items()), None)
            records.append(found or run_case(case))
            if found is None:
                later = [r for r in known if r not in records]
                write_file(path, "".join(json.dumps(r) + "\n" for r in records + later).encode())
                yield records[-1]
        write_file(path, "".join(json.dumps(r) + "\n" for r in records).encode())


def run_case(case: StressCase) -> dict[str, Any]:
    """The result of one case as plain values."""
    result = stress_guard(case.scenario, case.tc, case.episodes, case.driver, case.options, seed=case.seed)
    return result.as_json()
