"""Which runs stand in one table: one budget, the default cost and settings, and why others are missing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bench.records import Collection, Record
from bench.settings import DEFAULT_LIMIT, DEFAULT_SIGNAL
from bench.spec import RunSpec
from bench.summary import StageCounts, count_record

Budget = tuple[int, int]
"""Training steps, held-out episodes."""
Pair = tuple[str, str]
"""Scenario and method, canonical names."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The runs of one budget, by scenario and method.

    Attributes:
        collection: All runs.
        budget: The one that was chosen; None where nothing has run.
        steps: The training budget that was asked for, or None.
    """

    collection: Collection
    budget: Budget | None
    steps: int | None = None

    def records(self, scenario: str, method: str) -> list[Record]:
        """Finished records, in order of seed."""
        found = [r for r in self.collection.records if _fits(r.spec, scenario, method) and self.holds(r.spec)]
        return sorted(found, key=lambda record: record.spec.seed)

    def counts(self, scenario: str, method: str, stage: str) -> list[StageCounts]:
        """Counts of each seed."""
        return [count_record(record, stage) for record in self.records(scenario, method)]

    def holds(self, spec: RunSpec) -> bool:
        """Whether a run belongs here."""
        return _counts(spec, self.steps) and _budget(spec) == self.budget

    def absence(self, scenario: str, method: str) -> str:
        """What is missing at this budget, in one line; empty where nothing is."""
        lost = [
            f"seed {missing.spec.seed} {missing.reason}"
            for missing in self.collection.missing
            if _fits(missing.spec, scenario, method)
            and _counts(missing.spec, self.steps)
            and self.budget in (None, _budget(missing.spec))
        ]
        if lost:
            return "; ".join(sorted(lost))
        found = {
            _budget(record.spec)
            for record in self.collection.records
            if _fits(record.spec, scenario, method) and _counts(record.spec, None)
        }
        if self.budget in found:
            return ""
        if found:
            others = " and ".join(f"{s:,} steps with {e:,} episodes" for s, e in sorted(found))
            return f"only run with {others}"
        return f"no run; bench run --algo {method} --scenario {scenario} makes one"


def select(collection: Collection, wanted: Sequence[Pair], steps: int | None = None) -> Selection:
    """The budget at which most of the wanted pairs have a run, and among equals the largest.

    Args:
        collection: All runs.
        wanted: What the table shows.
        steps: Only runs of this training budget.
    """
    specs = [record.spec for record in collection.records if _counts(record.spec, steps)]
    return Selection(collection, choose_budget(specs, wanted), steps)


def choose_budget(specs: Iterable[RunSpec], wanted: Sequence[Pair]) -> Budget | None:
    """The budget at which most pairs have a run, then the largest; None without runs."""
    pairs: dict[Budget, set[Pair]] = {}
    for spec in specs:
        if (spec.scenario, spec.method) in wanted:
            pairs.setdefault(_budget(spec), set()).add((spec.scenario, spec.method))
    return max(pairs, key=lambda budget: (len(pairs[budget]), budget), default=None)


def tried(collection: Collection, scenario: str, method: str) -> bool:
    """Whether a pair was ever run, finished or not."""
    specs = [*(record.spec for record in collection.records), *(missing.spec for missing in collection.missing)]
    return any(_fits(spec, scenario, method) and _counts(spec, None) for spec in specs)


def _counts(spec: RunSpec, steps: int | None) -> bool:
    defaults = spec.cost_limit == DEFAULT_LIMIT and spec.cost_signal == DEFAULT_SIGNAL and not spec.settings
    return defaults and (steps is None or spec.steps == steps)


def _fits(spec: RunSpec, scenario: str, method: str) -> bool:
    return spec.scenario == scenario and spec.method == method


def _budget(spec: RunSpec) -> Budget:
    return spec.steps, spec.eval_episodes
