"""The paper's published figures, read from ``paper_tables/published.csv``, and our columns beside them.

Methods have their canonical names there, as in records; a test holds that, so that reading them loads no learner.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bench.provenance import PROJECT

PUBLISHED: Final = PROJECT / "paper_tables" / "published.csv"
TITLES: Final = {
    "ablation": "Results of the ablation experiments",
    "collision": "Collision rate statistics for different algorithms",
}
CONTROLS: Final = {
    "ablation": (("mean Tc", "dd-rq:tc=mean"), ("shuffled RQ", "dd-rq:rq=shuffled")),
    "collision": (),
}
"""Columns that the paper does not have: what DD-RQ must beat for its risk model to matter."""
PLUS: Final = {
    "ablation": (
        ("DD-RQ-plus", "dd-rq-plus"),
        ("plus, mean share", "dd-rq-plus:share=mean"),
        ("plus, shuffled", "dd-rq-plus:share=shuffled"),
        ("plus, unaware", "dd-rq-plus:aware=False"),
        ("Tc=3, aware", "safety-guard:aware=True"),
        ("no demand, aware", "safety-guard:aware=True,share=0.0"),
    ),
    "collision": (("DD-RQ-plus", "dd-rq-plus"),),
}
"""Columns of a method that is not the paper's: shown where it has been run."""

Recorded = Callable[[str, str], bool]
"""Whether a method has been run on a scenario."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One cell of a published table.

    Attributes:
        table: ``ablation`` or ``collision``.
        row: Statistic, as printed.
        column: Method, as printed.
        scenario: Name here.
        method: Canonical name here.
        stage: ``T`` or ``A``.
        metric: ``collision_rate``, ``speed_mps`` or ``intervention_ratio``.
        value: As printed; empty where the paper prints none.
        unit: As printed.
        source: Where it is printed; empty for a column that is not the paper's.
    """

    table: str
    row: str
    column: str
    scenario: str
    method: str
    stage: str
    metric: str
    value: str
    unit: str
    source: str


def read_figures(recorded: Recorded = lambda _scenario, _method: False, path: Path = PUBLISHED) -> list[Figure]:
    """All cells, the paper's and ours, in order of table and row.

    Args:
        recorded: Decides on the columns of `PLUS`; without it there are none.
        path: The published figures.
    """
    with path.open(newline="", encoding="utf-8") as file:
        figures = [Figure(**row) for row in csv.DictReader(file)]
    return [cell for table in TITLES for cell in _with_ours(table, figures, recorded)]


def _with_ours(table: str, figures: Sequence[Figure], recorded: Recorded) -> list[Figure]:
    rows: dict[tuple[str, str], list[Figure]] = {}
    for figure in figures:
        if figure.table == table:
            rows.setdefault((figure.row, figure.stage), []).append(figure)
    cells: list[Figure] = []
    for row in rows.values():
        plus = [(column, method) for column, method in PLUS[table] if recorded(row[0].scenario, method)]
        cells += row
        cells += [
            dataclasses.replace(row[0], column=column, method=method, value="", source="")
            for column, method in (*CONTROLS[table], *plus)
        ]
    return cells
