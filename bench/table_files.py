"""A table of published and own figures as Markdown, LaTeX (booktabs) and CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from bench.published import Figure
from bench.statistics import Interval


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
        return [str(cell.seeds or "") for cell in self.rows()[0][2]]

    def notes(self) -> list[str]:
        """Different reasons, in order of appearance; cells refer to them by number from 1."""
        return list(dict.fromkeys(cell.reason for cell in self.cells if cell.reason))


CSV_COLUMNS: Final = (
    "table", "row", "column", "scenario", "method", "stage", "metric", "unit", "value", "low", "high",
    "episodes", "seeds", "paper", "reason",
)  # fmt: skip


def to_csv(table: Table) -> str:
    """One line for each cell."""
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for cell in table.cells:
        f = cell.figure
        ours = [_number(cell.value), _number(cell.interval.low), _number(cell.interval.high)]
        writer.writerow(
            [f.table, f.row, f.column, f.scenario, f.method, f.stage, f.metric, f.unit, *ours, cell.n,
             cell.seeds, f.value, cell.reason]
        )  # fmt: skip
    return sink.getvalue()


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"


def _published(figure: Figure) -> str:
    return f"{figure.value} {figure.unit}" if figure.value else "/"


def _reference(cell: Cell, notes: Sequence[str]) -> str:
    return f"[{notes.index(cell.reason) + 1}]" if cell.reason else ""


def to_markdown(table: Table) -> str:
    """Two lines for each statistic and stage: here, and in the paper."""
    notes = table.notes()
    heading = ["", "stage", "", *table.columns()]
    lines = [
        f"# {table.title}",
        "",
        table.caption,
        "",
        f"| {' | '.join(heading)} |",
        "|" + "---|" * len(heading),
        f"| {' | '.join(['Seeds', '', 'here', *table.seeds()])} |",
    ]
    for row, stage, cells in table.rows():
        here = [" ".join(filter(None, (cell.text, _reference(cell, notes)))) for cell in cells]
        paper = [_published(cell.figure) for cell in cells]
        lines.append("| " + " | ".join([row, stage, "here", *here]) + " |")
        lines.append("| " + " | ".join(["", "", "paper", *paper]) + " |")
    lines += ["", *(f"[{i}] {note}  " for i, note in enumerate(notes, 1))]
    lines += [line for remark in table.remarks for line in ("", remark)]
    return "\n".join(lines).rstrip() + "\n"


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
    """A figure with its bracket on a second line, and the number of its note."""
    reference = f"\\textsuperscript{{{notes.index(cell.reason) + 1}}}" if cell.reason else ""
    if not cell.text:
        return f"--{reference}"
    head, bracket, tail = cell.text.partition(" (")
    if not bracket:
        return escape(head) + reference
    return f"\\begin{{tabular}}{{@{{}}c@{{}}}}{escape(head)}{reference}\\\\({escape(tail)}\\end{{tabular}}"


def to_latex(table: Table) -> str:
    """A ``table*`` that needs the package booktabs, and nothing else."""
    notes = table.notes()
    columns = table.columns()
    lines = [
        r"\begin{table*}",
        r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
        f"\\caption{{{escape(f'{table.title}. {table.caption}')}}}\\label{{tab:{table.name}}}",
        f"\\begin{{tabular}}{{lll{'c' * len(columns)}}}",
        r"\toprule",
        " & ".join(["", "Stage", "", *map(escape, columns)]) + r" \\",
        " & ".join(["Seeds", "", "here", *table.seeds()]) + r" \\",
    ]
    for row, stage, cells in table.rows():
        lines.append(r"\midrule")
        lines.append(" & ".join([escape(row), stage, "here", *(_tex_cell(cell, notes) for cell in cells)]) + r" \\")
        lines.append(" & ".join(["", "", "paper", *(escape(_published(c.figure)) for c in cells)]) + r" \\")
    lines += [r"\bottomrule", r"\end{tabular}"]
    below = [f"\\textsuperscript{{{i}}} {escape(note)}" for i, note in enumerate(notes, 1)]
    below += [escape(remark) for remark in table.remarks]
    if below:
        lines += ["", r"\smallskip", r"\begin{flushleft}", *(f"{line}\\\\" for line in below), r"\end{flushleft}"]
    lines.append(r"\end{table*}")
    return "\n".join(lines) + "\n"


FORMATS: Final[dict[str, Callable[[Table], str]]] = {"md": to_markdown, "tex": to_latex, "csv": to_csv}
