"""The paper's published figures, read from ``paper_tables/published.csv``, and our columns beside them."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from algorithms.registry import get_method
from bench.provenance import PROJECT
from envs.plugins import UnavailableError

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
        source: Where it is printed; empty for a control, which is not the paper's.
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


def _canonical(method: str) -> str:
    """A default parameter that is spelt out is left out, as in records."""
    try:
        return get_method(method).spec
    except (UnavailableError, ValueError):
        return method


def read_figures(path: Path = PUBLISHED) -> list[Figure]:
    """All cells, the paper's and the controls', in order of table and row."""
    with path.open(newline="", encoding="utf-8") as file:
        figures = [Figure(**row) for row in csv.DictReader(file)]
    names = {method: _canonical(method) for method in {figure.method for figure in figures}}
    figures = [dataclasses.replace(figure, method=names[figure.method]) for figure in figures]
    return [cell for table in TITLES for cell in _with_controls(table, figures)]


def _with_controls(table: str, figures: Sequence[Figure]) -> list[Figure]:
    own = [figure for figure in figures if figure.table == table]
    cells: list[Figure] = []
    for i, figure in enumerate(own):
        cells.append(figure)
        following = own[i + 1] if i + 1 < len(own) else None
        if following is None or (following.row, following.stage) != (figure.row, figure.stage):
            cells += [
                dataclasses.replace(figure, column=column, method=method, value="", source="")
                for column, method in CONTROLS[table]
            ]
    return cells
