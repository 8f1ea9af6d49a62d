"""A table of published and own figures as Markdown, LaTeX (booktabs) and CSV."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from bench.published import Figure
from bench.statistics import Interval
from bench.text import csv_text


@dataclass(frozen=True, slots=True)
class Cell:
    """Our figure beside a published one.

    Attributes:
        figure: The published one.
        text: Ours for people; empty where there is none.
        value: Ours, in the figure's unit; NaN where there is none.
        interval: Of it, over seeds.
        n: Episodes behind it.
        seeds: Seeds behind it.
        reason: What is missing, empty where nothing is.
    """

    figure: Figure
    text: str
    value: float
    interval: Interval
    n: int
    seeds: int
    reason: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table.

    Attributes:
        name: ``ablation`` or ``collision``.
        title: As in the paper.
        cells: In order of row, then column.
        caption: What the figures rest on.
        remarks: What follows from the figures.
    """

    name: str
    title: str
    cells: tuple[Cell, ...]
    caption: str
    remarks: tuple[str, ...] = ()

    def columns(self) -> list[str]:
        """Labels of the columns."""
        return list(dict.fromkeys(cell.figure.column for cell in self.cells))

    def rows(self) -> list[tuple[str, str, list[Cell]]]:
        """(statistic, stage, cells) of each row."""
        grouped: dict[tuple[str, str], list[Cell]] = {}
        for cell in self.cells:
            grouped.setdefault((cell.figure.row, cell.figure.stage), []).append(cell)
        return [(*key, cells) for key, cells in grouped.items()]

    def seeds(self) -> list[str]:
        """Number of seeds behind each column, empty where there is none."""
        return [_seeds(cell) for cell in self.rows()[0][2]]

    def notes(self) -> list[str]:
        """Different reasons, in order of appearance; cells refer to them by number from 1."""
        return list(dict.fromkeys(cell.reason for cell in self.cells if cell.reason))


CSV_COLUMNS: Final = (
    "table", "row", "column", "scenario", "method", "stage", "metric", "unit", "value", "low", "high",
    "episodes", "seeds", "paper", "reason",
)  # fmt: skip


def to_csv(table: Table) -> str:
    """One line for each cell."""
    lines = []
    for cell in table.cells:
        f = cell.figure
        ours = [_number(cell.value), _number(cell.interval.low), _number(cell.interval.high)]
        lines.append(
            [f.table, f.row, f.column, f.scenario, f.method, f.stage, f.metric, f.unit, *ours, cell.n,
             cell.seeds, f.value, cell.reason]
        )  # fmt: skip
    return csv_text(CSV_COLUMNS, lines)


def _seeds(cell: Cell) -> str:
    return str(cell.seeds or "")


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"


def _published(figure: Figure) -> str:
    return f"{figure.value} {figure.unit}" if figure.value else "/"


def _reference(cell: Cell, notes: Sequence[str]) -> str:
    return f"[{notes.index(cell.reason) + 1}]" if cell.reason else ""


def _kept(cells: Sequence[Cell], published: bool) -> list[Cell]:
    """Cells of the paper's columns, or of our own."""
    return [cell for cell in cells if bool(cell.figure.source) is published]


def to_markdown(table: Table) -> str:
    """Two lines for each statistic and stage, here and in the paper; columns that the paper lacks stand below."""
    notes = table.notes()
    lines = [f"# {table.title}", "", table.caption, "", *_markdown_columns(table, notes, published=True)]
    if any(not cell.figure.source for cell in table.cells):
        lines += ["", "Not in the paper:", "", *_markdown_columns(table, notes, published=False)]
    if notes:
        lines += ["", *(f"[{i}] {note}  " for i, note in enumerate(notes, 1))]
    lines += [line for remark in table.remarks for line in ("", remark)]
    return "\n".join(lines).rstrip() + "\n"


def _markdown_columns(table: Table, notes: Sequence[str], published: bool) -> list[str]:
    """The paper's columns with its figures below ours, or our own columns."""
    first = _kept(table.rows()[0][2], published)
    heading = ["", "stage", "", *(cell.figure.column for cell in first)]
    lines = [
        f"| {' | '.join(heading)} |",
        "|" + "---|" * len(heading),
        f"| {' | '.join(['Seeds', '', 'here', *map(_seeds, first)])} |",
    ]
    for row, stage, cells in table.rows():
        shown = _kept(cells, published)
        here = [" ".join(filter(None, (cell.text, _reference(cell, notes)))) for cell in shown]
        lines.append("| " + " | ".join([row, stage, "here", *here]) + " |")
        if published:
            lines.append("| " + " | ".join(["", "", "paper", *(_published(cell.figure) for cell in shown)]) + " |")
    return lines


_TEX: Final = {
    **{character: f"\\{character}" for character in "&%$#_{}"}, "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\ensuremath{<}", ">": r"\ensuremath{>}",
}  # fmt: skip


def escape(text: str) -> str:
    """Plain text as LaTeX."""
    return "".join(_TEX.get(character, character) for character in text).replace(
        r"\ensuremath{<}=", r"\ensuremath{\le}"
    )


def _tex_cell(cell: Cell, notes: Sequence[str]) -> str:
    """A figure with its bracket on a line of its own, and the number of its note."""
    reference = f"\\textsuperscript{{{notes.index(cell.reason) + 1}}}" if cell.reason else ""
    if not cell.text:
        return f"--{reference}"
    head, bracket, tail = cell.text.partition(" (")
    lines = [escape(line) for line in head.split(" = ")]
    lines[-1] += reference
    lines += [f"({escape(tail)}"] if bracket else []
    return _stacked(lines, "c")


def _stacked(lines: Sequence[str], align: str) -> str:
    """Lines of LaTeX in one cell."""
    text = r"\\".join(lines)
    return text if len(lines) == 1 else f"\\begin{{tabular}}{{@{{}}{align}@{{}}}}{text}\\end{{tabular}}"


def to_latex(table: Table) -> str:
    """A ``table*`` that needs the package booktabs, and nothing else; columns that the paper lacks stand below."""
    notes = table.notes()
    lines = [
        r"\begin{table*}",
        r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
        f"\\caption{{{escape(f'{table.title}. {table.caption}')}}}\\label{{tab:{table.name}}}",
        *_tabular(table, notes, published=True),
    ]
    if any(not cell.figure.source for cell in table.cells):
        lines += ["", r"\medskip", *_tabular(table, notes, published=False)]
    below = [f"\\textsuperscript{{{i}}} {escape(note)}" for i, note in enumerate(notes, 1)]
    below += [escape(remark) for remark in table.remarks]
    if below:
        lines += ["", r"\smallskip", r"\begin{flushleft}", *(f"{line}\\\\" for line in below), r"\end{flushleft}"]
    lines.append(r"\end{table*}")
    return "\n".join(lines) + "\n"


def _tabular(table: Table, notes: Sequence[str], published: bool) -> list[str]:
    """The paper's columns with its figures below ours, or our own columns."""
    first = _kept(table.rows()[0][2], published)
    lines = [
        f"\\begin{{tabular}}{{lll{'c' * len(first)}}}",
        r"\toprule",
        " & ".join(["", "Stage", "", *(escape(cell.figure.column) for cell in first)]) + r" \\",
        " & ".join(["Seeds", "", "here", *map(_seeds, first)]) + r" \\",
    ]
    for row, stage, cells in table.rows():
        shown = _kept(cells, published)
        lines.append(r"\midrule")
        label = _stacked(textwrap.wrap(escape(row), 18), "l")
        lines.append(" & ".join([label, stage, "here", *(_tex_cell(cell, notes) for cell in shown)]) + r" \\")
        if published:
            lines.append(" & ".join(["", "", "paper", *(escape(_published(c.figure)) for c in shown)]) + r" \\")
    return [*lines, r"\bottomrule", r"\end{tabular}"]


FORMATS: Final[dict[str, Callable[[Table], str]]] = {"md": to_markdown, "tex": to_latex, "csv": to_csv}
