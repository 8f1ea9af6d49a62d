"""Which runs of a scenario are shown beside its table: in figures, and compared in speed and return."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from bench.claims.evidence import TABLE_OF
from bench.records import Collection, Record
from bench.schema import column
from bench.settings import DEFAULT_LIMIT, DEFAULT_SIGNAL
from bench.statistics import Interval, SeedRate, mean_interval
from bench.summary import StageCounts, collision_rate, count_record
from bench.tables import table_selection
from envs.scenario import STEP_S

SCENARIOS: Final = tuple(TABLE_OF)
Scores = npt.NDArray[np.float64]
"""Of each held-out episode, shape (episodes,)."""


@dataclass(frozen=True, slots=True)
class Runs:
    """All seeds of one method on one scenario.

    Attributes:
        method: Canonical name.
        records: In order of seed.
    """

    method: str
    records: tuple[Record, ...]

    def counts(self, stage: str) -> list[StageCounts]:
        """Of each seed with an episode in the stage."""
        return [c for c in (count_record(record, stage) for record in self.records) if c.episodes]

    def collision_rate(self, stage: str) -> SeedRate:
        """Pooled, with its interval over seeds."""
        return collision_rate(self.counts(stage))

    def mean(self, stage: str, value: Callable[[StageCounts], float], scale: float = 1.0) -> tuple[float, Interval]:
        """Mean over seeds with its interval; NaN without runs, no interval of one seed."""
        values = [scale * value(c) for c in self.counts(stage)]
        if not values:
            return math.nan, Interval.none()
        estimate = mean_interval(values)
        return estimate.value, estimate.interval


def runs(collection: Collection, scenario: str) -> list[Runs]:
    """Methods at the budget of the scenario's table, and drivers that do not train, in order of name."""
    selection = table_selection(TABLE_OF[scenario], collection)
    chosen: dict[str, list[Record]] = {}
    for record in collection.records:
        spec = record.spec
        if spec.scenario != scenario:
            continue
        plain = spec.cost_limit == DEFAULT_LIMIT and spec.cost_signal == DEFAULT_SIGNAL and not spec.settings
        if selection.holds(spec) or (plain and spec.steps == 0):
            chosen.setdefault(spec.method, []).append(record)
    found = [Runs(method, tuple(_longest(records))) for method, records in chosen.items()]
    return sorted(found, key=lambda entry: entry.method)


def _longest(records: Sequence[Record]) -> list[Record]:
    """Drivers may have been evaluated on lists of several lengths: the longest, in order of seed."""
    most = max(record.spec.eval_episodes for record in records)
    return sorted((r for r in records if r.spec.eval_episodes == most), key=lambda record: record.spec.seed)


@functools.cache
def returns(record: Record) -> Scores:
    """Return without r_risk of each held-out episode, in order of number."""
    table = record.eval_episodes()
    total: Scores = column(table, "return_driving").astype(np.float64) + column(table, "return_comfort")
    return total


@functools.cache
def speeds(record: Record) -> Scores:
    """Distance / time of each held-out episode, in order of number [m/s]."""
    table = record.eval_episodes()
    mean: Scores = column(table, "distance").astype(np.float64) / (STEP_S * column(table, "steps").astype(np.float64))
    return mean
