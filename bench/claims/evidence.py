"""The runs behind a claim, chosen as the paper's tables choose theirs."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench import learning_curve
from bench.published import Figure, read_figures
from bench.records import Collection, Record
from bench.schema import column
from bench.selection import Selection
from bench.summary import StageCounts, count_record
from bench.tables import table_selection
from envs.world import Ending

TABLE_OF: Final = {"a": "ablation", "b": "collision"}
"""The table whose budget the runs of a scenario have."""


@dataclass(frozen=True, slots=True)
class Group:
    """All seeds of a method on a scenario in one stage.

    Attributes:
        scenario: Name.
        method: Canonical name.
        stage: ``T`` or ``A``.
        records: Of the seeds with at least one episode that counts, in order of seed.
        counts: Their counts.
        episodes: Of all seeds, as far as the claim looks at them.
        missing: What is missing, empty where nothing is.
    """

    scenario: str
    method: str
    stage: str
    records: tuple[Record, ...]
    counts: tuple[StageCounts, ...]
    episodes: int
    missing: str

    @property
    def key(self) -> tuple[str, str, str]:
        """Tells groups apart."""
        return self.scenario, self.method, self.stage

    @property
    def label(self) -> str:
        """For people."""
        return f"{self.method} on {self.scenario}, {self.stage}"

    def values(self, value: Callable[[StageCounts], float]) -> list[float]:
        """One value for each seed."""
        return [value(c) for c in self.counts]


class Evidence:
    """Runs and published figures by scenario, method and stage."""

    def __init__(self, collection: Collection) -> None:
        self._selections: dict[str, Selection] = {
            scenario: table_selection(table, collection) for scenario, table in TABLE_OF.items()
        }
        self._published: list[Figure] = [figure for figure in read_figures() if figure.source]

    def group(self, scenario: str, method: str, stage: str) -> Group:
        """The runs of the budget of the scenario's table."""
        selection = self._selections[scenario]
        records = tuple(r for r in selection.records(scenario, method) if count_record(r, stage).episodes)
        counts = tuple(count_record(record, stage) for record in records)
        missing = "" if records else selection.absence(scenario, method) or "no finished episode"
        return Group(scenario, method, stage, records, counts, sum(c.episodes for c in counts), missing)

    def steps(self, scenario: str) -> int:
        """Training budget of the scenario's table; 0 without runs."""
        budget = self._selections[scenario].budget
        return budget[0] if budget else 0

    def paper(self, scenario: str, method: str, stage: str, metric: str) -> float:
        """A published figure as printed; NaN where the paper prints none."""
        for f in self._published:
            if (f.scenario, f.method, f.stage, f.metric) == (scenario, method, stage, metric) and f.value:
                return float(f.value)
        return float("nan")

    def methods(self, scenario: str, name: str) -> list[str]:
        """The published methods of a scenario whose name, without parameters, is the given one."""
        found = [f.method for f in self._published if f.scenario == scenario and f.method.partition(":")[0] == name]
        return list(dict.fromkeys(found))


@functools.cache
def collided(record: Record) -> npt.NDArray[np.bool_]:
    """Whether each held-out episode ended in a collision, in order of number."""
    flags: npt.NDArray[np.bool_] = column(record.eval_episodes(), "ending") == Ending.COLLISION
    return flags


@functools.cache
def return_after(record: Record, start: int, width: int) -> tuple[float, int]:
    """Mean return without r_risk over windows of training that begin at ``start``, and the episodes in them.

    The mean of window means: a stretch of short episodes counts no more than one of long episodes.
    """
    curve = learning_curve.of(record, width)
    later = curve.start >= start
    means: npt.NDArray[Any] = curve.returns[later & (curve.episodes > 0)]
    value = float(means.mean()) if len(means) else float("nan")
    return value, int(curve.episodes[later].sum())
