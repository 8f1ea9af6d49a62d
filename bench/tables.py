"""The paper's two tables with our figures in them, from records alone.

A table holds one budget (training steps, held-out episodes): the one that fills most of its columns, and
among equals the largest. Only runs with the default cost and settings count. A cell without a run stays empty
and gives its reason. Intervals are over seeds: `bench.statistics.seed_rate` for collisions, Student's t else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bench import atomic, table_files
from bench.published import TITLES, Figure, read_figures
from bench.records import Collection, Record
from bench.settings import DEFAULT_LIMIT, DEFAULT_SIGNAL
from bench.spec import RunSpec
from bench.statistics import Interval, Rate, SeedInterval, format_rate, seed_rate
from bench.statistics.resampling import t_interval
from bench.summary import StageCounts, count_record
from bench.table_files import Cell, Table

Budget = tuple[int, int]
"""Training steps, held-out episodes."""
LEVEL: Final = 0.95


@dataclass(frozen=True, slots=True)
class Measured:
    """What our runs say about one cell; percent for shares.

    Attributes:
        value: NaN where nothing can be said.
        interval: Over seeds.
        text: For people.
        n: Episodes behind it.
    """

    value: float
    interval: Interval
    text: str
    n: int


def write(collection: Collection, folder: Path, steps: int | None = None) -> list[Path]:
    """Write each table as Markdown, LaTeX and CSV; the same records give the same bytes.

    Args:
        collection: The records.
        folder: Where to.
        steps: Only runs of this training budget.

    Returns:
        The files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = read_figures()
    paths = []
    for name in TITLES:
        table = build(name, [figure for figure in figures if figure.table == name], collection, steps)
        for suffix, render in table_files.FORMATS.items():
            path = folder / f"{name}.{suffix}"
            atomic.write_file(path, render(table).encode())
            paths.append(path)
    return paths


def build(name: str, figures: Sequence[Figure], collection: Collection, steps: int | None = None) -> Table:
    """One table."""
    records = [record for record in collection.records if _counts(record.spec, steps)]
    wanted = list(dict.fromkeys((figure.scenario, figure.method) for figure in figures))
    budget = choose_budget([record.spec for record in records], wanted)
    groups = {
        (scenario, method): sorted(
            (r for r in records if _fits(r.spec, scenario, method) and _budget(r.spec) == budget),
            key=lambda record: record.spec.seed,
        )
        for scenario, method in wanted
    }
    counted: dict[tuple[str, str, str], list[StageCounts]] = {}
    cells = []
    for figure in figures:
        group = groups[figure.scenario, figure.method]
        key = (figure.scenario, figure.method, figure.stage)
        if key not in counted:
            counted[key] = [count_record(record, figure.stage) for record in group]
        cells.append(_cell(figure, group, counted[key], absence(figure, collection, budget, steps)))
    return Table(name, TITLES[name], tuple(cells), _caption(budget, records, wanted))


def _counts(spec: RunSpec, steps: int | None) -> bool:
    defaults = spec.cost_limit == DEFAULT_LIMIT and spec.cost_signal == DEFAULT_SIGNAL and not spec.settings
    return defaults and (steps is None or spec.steps == steps)


def _fits(spec: RunSpec, scenario: str, method: str) -> bool:
    return spec.scenario == scenario and spec.method == method


def _budget(spec: RunSpec) -> Budget:
    return spec.steps, spec.eval_episodes


def choose_budget(specs: Sequence[RunSpec], wanted: Sequence[tuple[str, str]]) -> Budget | None:
    """The budget at which most (scenario, method) pairs have a run, then the largest; None without runs."""
    pairs: dict[Budget, set[tuple[str, str]]] = {}
    for spec in specs:
        if (spec.scenario, spec.method) in wanted:
            pairs.setdefault(_budget(spec), set()).add((spec.scenario, spec.method))
    return max(pairs, key=lambda budget: (len(pairs[budget]), budget), default=None)


def absence(figure: Figure, collection: Collection, budget: Budget | None, steps: int | None) -> str:
    """What is missing for a figure at the table's budget, in one line; empty where nothing is."""
    lost = [
        f"seed {missing.spec.seed} {missing.reason}"
        for missing in collection.missing
        if _fits(missing.spec, figure.scenario, figure.method)
        and _counts(missing.spec, steps)
        and (budget is None or _budget(missing.spec) == budget)
    ]
    if lost:
        return "; ".join(sorted(lost))
    found = {
        _budget(record.spec)
        for record in collection.records
        if _fits(record.spec, figure.scenario, figure.method) and _counts(record.spec, None)
    }
    if budget in found:
        return ""
    if found:
        others = " and ".join(f"{s:,} steps with {e:,} episodes" for s, e in sorted(found))
        return f"only run with {others}"
    return f"no run; bench run --algo {figure.method} --scenario {figure.scenario} makes one"


def _cell(figure: Figure, group: Sequence[Record], counts: Sequence[StageCounts], missing: str) -> Cell:
    if not group:
        return Cell(figure, "", math.nan, Interval.none(LEVEL), 0, 0, missing)
    measured = METRICS[figure.metric](counts)
    reason = missing
    if math.isnan(measured.value):
        reason = "; ".join(filter(None, ("no finished episode", missing)))
    return Cell(figure, measured.text, measured.value, measured.interval, measured.n, len(group), reason)


def _collision_rate(counts: Sequence[StageCounts]) -> Measured:
    rate = seed_rate([c.collisions for c in counts], [c.episodes for c in counts])
    if not rate.trials:
        return Measured(math.nan, Interval.none(LEVEL), "", 0)
    text = format_rate(Rate(rate.events, rate.trials, rate.interval))
    if rate.method is SeedInterval.CLOPPER_PEARSON and rate.events and len(counts) == 1:
        text += ", one seed"
    low, high = 100.0 * rate.interval.low, 100.0 * rate.interval.high
    return Measured(100.0 * rate.value, Interval(low, high, LEVEL), text, rate.trials)


def _over_seeds(values: Sequence[float], counts: Sequence[StageCounts], scale: float, unit: str) -> Measured:
    """Mean of the seeds with a t interval."""
    present = scale * np.array([value for value in values if math.isfinite(value)])
    if not len(present):
        return Measured(math.nan, Interval.none(LEVEL), "", 0)
    value = float(present.mean())
    interval = Interval.none(LEVEL)
    if len(present) > 1:
        error = float(present.std(ddof=1)) / math.sqrt(len(present))
        interval = t_interval(value, error, len(present) - 1, LEVEL)
        interval = Interval(max(0.0, interval.low), interval.high, LEVEL)
    spread = ", one seed" if interval.empty else f" ({interval.low:.2f} to {interval.high:.2f})"
    return Measured(value, interval, f"{value:.2f} {unit}{spread}", sum(c.episodes for c in counts))


def _speed(counts: Sequence[StageCounts]) -> Measured:
    return _over_seeds([c.speed_mps for c in counts], counts, 1.0, "m/s")


def _interventions(counts: Sequence[StageCounts]) -> Measured:
    return _over_seeds([c.intervention_ratio for c in counts], counts, 100.0, "%")


METRICS: Final[dict[str, Callable[[Sequence[StageCounts]], Measured]]] = {
    "collision_rate": _collision_rate,
    "speed_mps": _speed,
    "intervention_ratio": _interventions,
}


def _caption(budget: Budget | None, records: Sequence[Record], wanted: Sequence[tuple[str, str]]) -> str:
    if budget is None:
        return "No run yet."
    used = [r for r in records if (r.spec.scenario, r.spec.method) in wanted and _budget(r.spec) == budget]
    seeds = sorted({record.spec.seed for record in used})
    scenarios = ", ".join(sorted({record.spec.scenario_id for record in used}))
    return (
        f"Scenario {scenarios}; {budget[0]:,} training steps of 0.1 s, {budget[1]:,} held-out episodes for "
        f"each of {len(seeds)} seed{'s' if len(seeds) != 1 else ''}. "
        "T: training, A: application. In brackets 95 % intervals over seeds; a zero gives a one-sided bound."
    )
