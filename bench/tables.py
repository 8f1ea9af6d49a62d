"""The paper's two tables with our figures in them, from records alone.

A table holds one budget (training steps, held-out episodes), see `bench.selection`. A cell without a run stays
empty and gives its reason. Intervals are over seeds: `bench.statistics.seed_rate` for collisions, Student's t else.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from algorithms import atomic
from bench import controls, table_files
from bench.published import TITLES, Figure, read_figures
from bench.records import Collection
from bench.selection import Selection, select, tried
from bench.statistics import Interval, SeedInterval, format_rate, mean_interval
from bench.summary import StageCounts, collision_rate
from bench.table_files import Cell, Table

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
    paths = []
    for name in TITLES:
        table = build(name, collection, steps)
        for suffix, render in table_files.FORMATS.items():
            path = folder / f"{name}.{suffix}"
            atomic.write_file(path, render(table).encode())
            paths.append(path)
    return paths


def build(name: str, collection: Collection, steps: int | None = None) -> Table:
    """One table: ``ablation`` or ``collision``."""
    figures = table_figures(name, collection)
    selection = table_selection(name, collection, steps)
    cells = tuple(cell(figure, selection) for figure in figures)
    scenario = figures[0].scenario
    remarks = controls.remarks(selection, scenario) if name == "ablation" else []
    return Table(name, TITLES[name], cells, _caption(selection, scenario, cells), tuple(remarks))


def table_figures(name: str, collection: Collection) -> list[Figure]:
    """Cells of a table; columns of our own methods only where they have been run."""
    return [figure for figure in read_figures(functools.partial(tried, collection)) if figure.table == name]


def table_selection(name: str, collection: Collection, steps: int | None = None) -> Selection:
    """The runs of a table; the paper's columns and their controls decide on the budget."""
    wanted = [(figure.scenario, figure.method) for figure in read_figures() if figure.table == name]
    return select(collection, list(dict.fromkeys(wanted)), steps)


def cell(figure: Figure, selection: Selection) -> Cell:
    """Our figure beside a published one, or the reason why there is none."""
    counts = selection.counts(figure.scenario, figure.method, figure.stage)
    missing = selection.absence(figure.scenario, figure.method)
    if not counts:
        return Cell(figure, "", math.nan, Interval.none(LEVEL), 0, 0, missing)
    measured = METRICS[figure.metric](counts)
    if math.isnan(measured.value):
        missing = "; ".join(filter(None, ("no finished episode", missing)))
    return Cell(figure, measured.text, measured.value, measured.interval, measured.n, len(counts), missing)


def _collision_rate(counts: Sequence[StageCounts]) -> Measured:
    rate = collision_rate(counts)
    if not rate.trials:
        return Measured(math.nan, Interval.none(LEVEL), "", 0)
    text = format_rate(rate.rate)
    if rate.method is SeedInterval.CLOPPER_PEARSON and rate.events and len(counts) == 1:
        text += ", one seed"
    percent = Interval(100.0 * rate.stated.low, 100.0 * rate.stated.high, LEVEL)
    return Measured(100.0 * rate.value, percent, text, rate.trials)


def _over_seeds(values: Sequence[float], counts: Sequence[StageCounts], scale: float, unit: str) -> Measured:
    """Mean of the seeds with a t interval."""
    present = [scale * value for value in values if math.isfinite(value)]
    if not present:
        return Measured(math.nan, Interval.none(LEVEL), "", 0)
    estimate = mean_interval(present, LEVEL)
    value, interval = estimate.value, estimate.interval
    if not interval.empty:
        interval = Interval(max(0.0, interval.low), interval.high, LEVEL)
    if not any(present):
        return Measured(value, interval, f"0 {unit}", sum(c.episodes for c in counts))
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


def _caption(selection: Selection, scenario: str, cells: Sequence[Cell]) -> str:
    filled = [cell for cell in cells if cell.seeds]
    if selection.budget is None or not filled:
        return "No run yet."
    steps, episodes = selection.budget
    ids = {r.spec.scenario_id for c in filled for r in selection.records(scenario, c.figure.method)}
    seeds = sorted({cell.seeds for cell in filled})
    number = f"{seeds[0]} seed{'s' if seeds[0] != 1 else ''}" if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]} seeds"
    return (
        f"Scenario {', '.join(sorted(ids))}; {steps:,} training steps of 0.1 s, the same {episodes:,} held-out "
        f"episodes for each of {number}. T: training, A: application. In brackets 95 % intervals over seeds; a zero "
        "gives a one-sided bound, for which a held-out episode counts once."
    )
