"""What each figure is, as a formula over the columns of the records, and as code that computes just that.

On purpose a second way to each figure, straight from the Parquet columns: the tables sum counts of seeds
(`bench.summary`), and `bench why` finds out if they ever differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench.statistics import Interval, exact_rate, seed_rate
from envs.world import Ending, Fault

Columns = Mapping[str, npt.NDArray[Any]]
"""Columns of one seed's episodes, as float64."""
Compute = Callable[[Sequence[Columns]], float]


@dataclass(frozen=True, slots=True)
class Query:
    """A figure.

    Attributes:
        formula: Over the columns, for people.
        columns: That it reads.
        compute: The figure of several seeds; NaN where nothing can be said.
    """

    formula: str
    columns: tuple[str, ...]
    compute: Compute


def _pooled(seeds: Sequence[Columns]) -> dict[str, npt.NDArray[Any]]:
    return {name: np.concatenate([columns[name] for columns in seeds]) for name in seeds[0]}


def _over_all(formula: str, columns: tuple[str, ...], figure: Callable[[Columns], float]) -> Query:
    """A figure of the episodes of all seeds together."""
    return Query(f"{formula}, episodes of all seeds together", columns, lambda seeds: figure(_pooled(seeds)))


def _share(column: str) -> Query:
    return _over_all(f"sum({column}) / sum(steps)", (column, "steps"), lambda c: c[column].sum() / c["steps"].sum())


def _mean(column: str) -> Query:
    return _over_all(f"mean({column})", (column,), lambda c: c[column].mean())


def _ending(ending: Ending) -> Query:
    text = f"mean(ending = {int(ending)})"
    return _over_all(text, ("ending",), lambda c: float((c["ending"] == ending).mean()))


def _fault(fault: Fault) -> Query:
    return _over_all(f"sum(fault = {int(fault)})", ("fault",), lambda c: float((c["fault"] == fault).sum()))


def _collisions(columns: Columns) -> int:
    return int((columns["ending"] == Ending.COLLISION).sum())


def _scenarios(seeds: Sequence[Columns], stage: str) -> int:
    """In application all seeds drive the same list, in training each its own."""
    numbers = [len(c["ending"]) for c in seeds]
    return max(numbers) if stage == "A" else sum(numbers)


def _exact(seeds: Sequence[Columns], stage: str) -> Interval:
    episodes = sum(len(c["ending"]) for c in seeds)
    collisions = sum(map(_collisions, seeds))
    return exact_rate(collisions, episodes, independent=_scenarios(seeds, stage)).interval


def _over_seeds(seeds: Sequence[Columns], stage: str) -> Interval:
    episodes = [len(c["ending"]) for c in seeds]
    if sum(n > 0 for n in episodes) < 2:
        return Interval.none()
    return seed_rate([_collisions(c) for c in seeds], episodes, independent=_scenarios(seeds, stage)).interval


def _speed(columns: Columns) -> float:
    return float((columns["distance"] / (0.1 * columns["steps"])).mean())


def _interventions(columns: Columns) -> float:
    return float(columns["interventions"].sum() / columns["steps"].sum())


def _seed_mean(formula: str, columns: tuple[str, ...], figure: Callable[[Columns], float], scale: float) -> Query:
    """The mean of the figures of the seeds that have an episode."""

    def compute(seeds: Sequence[Columns]) -> float:
        values = [scale * figure(c) for c in seeds if len(c[columns[0]])]
        return float(np.mean(values)) if values else math.nan

    return Query(f"mean over seeds of {formula}", columns, compute)


_RATE: Final = f"sum(ending = {int(Ending.COLLISION)}) / count(*)"
_LEADERBOARD: Final[dict[str, Query]] = {
    "episodes": _over_all("count(*)", ("ending",), lambda c: float(len(c["ending"]))),
    "collisions": _over_all(f"sum(ending = {int(Ending.COLLISION)})", ("ending",), lambda c: float(_collisions(c))),
    "collision_rate": _over_all(_RATE, ("ending",), lambda c: _collisions(c) / len(c["ending"])),
    "ego_at_fault": _over_all("sum(ego_at_fault)", ("ego_at_fault",), lambda c: c["ego_at_fault"].sum()),
    "ahead_collisions": _fault(Fault.AHEAD),
    "side_collisions": _fault(Fault.SIDE),
    "rear_ended": _fault(Fault.REAR_ENDED),
    "pedestrian_collisions": _fault(Fault.PEDESTRIAN),
    "collisions_per_1000_km": _over_all(
        f"1e6 * sum(ending = {int(Ending.COLLISION)}) / sum(distance)",
        ("ending", "distance"),
        lambda c: 1e6 * _collisions(c) / c["distance"].sum(),
    ),
    "speed_mps": _over_all("mean(distance / (0.1 * steps))", ("distance", "steps"), _speed),
    "intervention_ratio": _share("interventions"),
    "altered_share": _share("altered"),
    "return_without_risk": _over_all(
        "mean(return_driving + return_comfort)",
        ("return_driving", "return_comfort"),
        lambda c: (c["return_driving"] + c["return_comfort"]).mean(),
    ),
    "return_driving": _mean("return_driving"),
    "return_comfort": _mean("return_comfort"),
    "return_risk": _mean("return_risk"),
    "episode_cost": _mean("cost"),
    "goal": _ending(Ending.GOAL),
    "collision": _ending(Ending.COLLISION),
    "off_road": _ending(Ending.OFF_ROAD),
    "time_out": _ending(Ending.TIME_OUT),
    "ttc_min_median_s": _over_all("median(ttc_min)", ("ttc_min",), lambda c: float(np.median(c["ttc_min"]))),
    "inside_safe_gap": _share("steps_inside_safe_gap"),
    "low_ttc": _share("steps_low_ttc"),
    "hard_braking": _share("steps_hard_braking"),
    "jerk_mps3": _share("jerk_sum"),
    "lane_changes": _mean("lane_changes"),
}


def of_leaderboard(stage: str) -> dict[str, Query]:
    """By column of the leaderboard, for stage ``T`` or ``A``; the other columns are read from ``run.json``."""
    exact = "bench.statistics.exact_rate of all seeds together, each distinct episode once"
    over_seeds = f"bench.statistics.seed_rate of each seed's {_RATE}"
    ending = ("ending",)
    return {
        **_LEADERBOARD,
        "scenarios": Query(
            f"{'max' if stage == 'A' else 'sum'} over seeds of count(*)", ending, lambda s: float(_scenarios(s, stage))
        ),
        "collision_low": Query(f"{exact}, lower end", ending, lambda s: _exact(s, stage).low),
        "collision_high": Query(f"{exact}, upper end", ending, lambda s: _exact(s, stage).high),
        "collision_seeds_low": Query(f"{over_seeds}, lower end", ending, lambda s: _over_seeds(s, stage).low),
        "collision_seeds_high": Query(f"{over_seeds}, upper end", ending, lambda s: _over_seeds(s, stage).high),
    }


TABLES: Final[dict[str, Query]] = {
    "collision_rate": _over_all(f"100 * {_RATE}", ("ending",), lambda c: 100.0 * _collisions(c) / len(c["ending"])),
    "speed_mps": _seed_mean("mean(distance / (0.1 * steps))", ("distance", "steps"), _speed, 1.0),
    "intervention_ratio": _seed_mean(
        "100 * sum(interventions) / sum(steps)", ("interventions", "steps"), _interventions, 100.0
    ),
}
"""By metric of the paper's tables: percent and m/s."""
