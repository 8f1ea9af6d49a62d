"""What docs/guard.md shows: the stress cases on record, and their tables."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from algorithms.atomic import write_file
from algorithms.guard_options import GuardOptions
from algorithms.versions import GUARD_VERSION
from bench import stress
from bench.errors import UsageError
from bench.statistics import exact_rate, format_rate
from bench.stress import FULL_THROTTLE_LANE_CHANGE, RANDOM
from bench.stress_result import DD_RQ, Tc
from envs.scenario import get_scenario

DEFAULTS: Final = GuardOptions()


@dataclass(frozen=True, slots=True)
class StressCase:
    """Settings of one call of `bench.stress.command`."""

    scenario: str
    tc: Tc
    driver: str = RANDOM
    episodes: int = 20_000
    options: GuardOptions = DEFAULTS
    seed: int = 0
    agent_steps: int = 500_000

    @property
    def settings(self) -> dict[str, Any]:
        """As in the result, with the versions of scenario and guard."""
        return {
            "scenario": get_scenario(self.scenario).id,
            "tc": self.tc,
            "driver": self.driver,
            "episodes": self.episodes,
            "seed": self.seed,
            "agent_steps": self.agent_steps if self.tc == DD_RQ else None,
            "options": dataclasses.asdict(self.options),
            "guard_version": GUARD_VERSION,
        }

    def answered_by(self, record: dict[str, Any]) -> bool:
        """Whether a record is of these settings, with as many episodes or more."""
        wanted = self.settings
        return wanted.pop("episodes") <= record["episodes"] and wanted.items() <= record.items()


HEAD: Final = ("scenario", "T_c", "driver", "guard", "collisions", "at fault", "with", "flagged", "speed", "episodes")
SHOWN: Final = 3
"""Episodes with a collision that a table names."""
_PRINTED: Final = GuardOptions(True, True, True, True, False, False, False, False, False)
_ABLATION: Final = (
    DEFAULTS,
    GuardOptions(reserve=False),
    GuardOptions(hold=False),
    GuardOptions(give_way=False),
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
_TIMES: Final[tuple[Tc, ...]] = (0.5, 1.0, 3.0, 5.0, 7.0, DD_RQ)
CASES: Final[dict[str, tuple[StressCase, ...]]] = {
    "random-actions": tuple(StressCase(scenario, tc, episodes=100_000) for scenario in "ab" for tc in _TIMES),
    "variants": tuple(StressCase(scenario, tc, driver) for scenario, driver in _VARIANTS for tc in (1.0, 3.0)),
    "ablation": tuple(
        StressCase("b", tc, FULL_THROTTLE_LANE_CHANGE, options=options) for options in _ABLATION for tc in (3.0, 7.0)
    ),
}
"""What docs/guard.md reports; each set has a file of its own among the records."""


def read_records(path: Path) -> list[dict[str, Any]]:
    """Results of a file of JSON lines, none where there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def record_cases(path: Path, cases: Sequence[StressCase], cache: Path) -> Iterator[dict[str, Any]]:
    """Run what is missing among the records of a file, and yield each new one.

    Args:
        path: File of JSON lines; records of other settings or versions are dropped.
        cases: What it is to hold, in this order.
        cache: Of the driving agent and risk model behind ``dd-rq``.
    """
    known = read_records(path)
    records: list[dict[str, Any]] = []
    for case in cases:
        found = next((r for r in known if case.answered_by(r)), None)
        records.append(found or run_case(case, cache))
        if found is None:
            later = [r for r in known if r not in records]
            write_file(path, "".join(json.dumps(r) + "\n" for r in records + later).encode())
            yield records[-1]
    write_file(path, "".join(json.dumps(r) + "\n" for r in records).encode())


def run_case(case: StressCase, cache: Path) -> dict[str, Any]:
    """The result of one case as plain values."""
    changed = [f"{k}={str(v).lower()}" for k, v in dataclasses.asdict(case.options).items()]
    return stress.command(
        case.scenario, str(case.tc), case.episodes, case.driver, case.seed, case.agent_steps, cache, changed
    ).as_json()


def command(results: Path, only: str | None, episodes: int | None, agent_steps: int) -> Iterator[str]:
    """Bring sets of `CASES` up to date; a line for each new record.

    Raises:
        UsageError: There is no such set.
    """
    if only is not None and only not in CASES:
        raise UsageError(f"There is no set {only!r}; there are: {', '.join(CASES)}.")
    folder = results / "stress"
    folder.mkdir(parents=True, exist_ok=True)
    for name in [only] if only else list(CASES):
        cases = [
            dataclasses.replace(case, episodes=episodes or case.episodes, agent_steps=agent_steps)
            for case in CASES[name]
        ]
        for record in record_cases(folder / f"{name}.json", cases, results / "cache"):
            yield f"{name}: " + " ".join(_row(record))


def table(folder: Path, name: str) -> str:
    """A set's records as a Markdown table."""
    rows = [HEAD, ["---"] * len(HEAD), *map(_row, read_records(folder / f"{name}.json"))]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _row(record: dict[str, Any]) -> list[str]:
    """Cells of a record."""
    n = record["episodes"]
    counted = {"pedestrian": "pedestrian", "ahead": "car ahead", "side": "side", "rear_ended": "rear-ended"}
    kinds = ", ".join(f"{text} {record[key]}" for key, text in counted.items() if record[key])
    tc = record["tc"]
    return [
        record["scenario"],
        f"`{tc}`" if tc == DD_RQ else f"{tc:g} s",
        record["driver"],
        changed_options(record["options"]),
        format_rate(exact_rate(record["collisions"], n)),
        format_rate(exact_rate(record["ego_at_fault"], n)),
        kinds or "-",
        f"{100.0 * record['intervention_ratio']:.1f} %",
        f"{record['mean_speed_mps']:.2f} m/s",
        ", ".join(map(str, record["worst"][:SHOWN])) if record["collisions"] else "-",
    ]


def changed_options(options: dict[str, bool]) -> str:
    """The options that differ from the defaults, as ``--set`` takes them."""
    defaults = dataclasses.asdict(DEFAULTS)
    return " ".join(f"`{k}={str(v).lower()}`" for k, v in options.items() if v != defaults[k]) or "default"
