"""From a cell to the records behind it, and back from these to the figure."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench import leaderboard, store, tables
from bench.errors import UsageError
from bench.published import Figure
from bench.records import Collection, Record
from bench.schema import column
from bench.statistics import format_rate
from bench.summary import count_record, pooled
from bench.why.address import BOARD, Address
from bench.why.queries import TABLES, Query, of_leaderboard
from envs.scenario import UnknownNameError

FILES = {"T": store.TRAIN_FILE, "A": store.EVAL_FILE}


@dataclass(frozen=True, slots=True)
class Trace:
    """What stands behind a cell.

    Attributes:
        cell: Its address.
        method: Canonical name.
        scenario: Name and version.
        stage: ``T`` or ``A``.
        records: Behind it, in order of seed; empty for an empty cell.
        reason: Why it is empty or incomplete.
        formula: The query.
        columns: That the query reads, of ``file``.
        file: Of each record.
        value: Computed again from the records, as the CSV file writes it.
        path: The CSV file with the cell.
        stated: What it says; None without the file or the row.
        paper: The published figure with its source; empty where there is none.
    """

    cell: str
    method: str
    scenario: str
    stage: str
    records: tuple[Record, ...]
    reason: str
    formula: str
    columns: tuple[str, ...]
    file: str
    value: str
    path: Path
    stated: str | None
    paper: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the file, if it is there, says what the records say."""
        return self.stated in (None, self.value)


def trace(address: Address, collection: Collection, folder: Path) -> Trace:
    """Where a cell comes from.

    Args:
        address: The cell.
        collection: All runs.
        folder: Where the table's CSV file is.

    Raises:
        UsageError: There is no such cell.
        RecordError: A record cannot be used.
    """
    if address.table == BOARD:
        return _board(address, collection, folder / "leaderboard.csv")
    return _paper(address, collection, folder / f"{address.table}.csv")


def _paper(address: Address, collection: Collection, path: Path) -> Trace:
    figures = tables.table_figures(address.table, collection)
    figure = _find(address, figures)
    selection = tables.table_selection(address.table, collection)
    records = tuple(selection.records(figure.scenario, figure.method))
    query = TABLES[figure.metric]
    key = {"row": figure.row, "column": figure.column, "stage": figure.stage}
    return Trace(
        cell=address.text,
        method=figure.method,
        scenario=records[0].spec.scenario_id if records else figure.scenario,
        stage=figure.stage,
        records=records,
        reason=selection.absence(figure.scenario, figure.method),
        formula=query.formula,
        columns=query.columns,
        file=FILES[figure.stage],
        value=_number(_compute(query, records, figure.stage)),
        path=path,
        stated=_stated(path, key, "value"),
        paper=f"{figure.value} {figure.unit}, {figure.source}" if figure.source and figure.value else "",
    )


def _find(address: Address, figures: Sequence[Figure]) -> Figure:
    methods = [name for f in figures for name in (f.column, f.method)]
    statistics = [name for f in figures for name in (f.row, f.metric)]
    for kind, name, known in (("column", address.method, methods), ("statistic", address.figure, statistics)):
        if name not in known:
            raise UsageError(f"{address.table}: {UnknownNameError(kind, name, list(dict.fromkeys(known)))}")
    return next(
        f
        for f in figures
        if address.method in (f.column, f.method) and address.figure in (f.row, f.metric) and address.stage == f.stage
    )


def _board(address: Address, collection: Collection, path: Path) -> Trace:
    if address.figure not in leaderboard.COLUMNS:
        raise UsageError(str(UnknownNameError("column", address.figure, list(leaderboard.COLUMNS))))
    row = _row(address, leaderboard.rows(collection.records))
    records = tuple(
        sorted(
            (r for r in collection.records if _in_row(r, row)),
            key=lambda record: record.spec.seed,
        )
    )
    query = of_leaderboard(address.stage).get(address.figure)
    value = row[address.figure] if query is None else _compute(query, records, address.stage)
    if isinstance(row[address.figure], int) and not math.isnan(value):
        value = int(value)
    key = {name: leaderboard.number(row[name]) for name in _KEY}
    return Trace(
        cell=address.text,
        method=row["method"],
        scenario=row["scenario"],
        stage=row["stage"],
        records=records,
        reason="",
        formula=query.formula if query else leaderboard.COLUMNS[address.figure],
        columns=query.columns if query else (),
        file=FILES[address.stage] if query else store.RUN_FILE,
        value=leaderboard.number(value),
        path=path,
        stated=_stated(path, key, address.figure),
    )


_KEY = ("method", "scenario", "stage", "steps", "eval_episodes", "cost_limit", "cost_signal", "settings")


def _in_row(record: Record, row: leaderboard.Row) -> bool:
    spec = record.spec
    settings = " ".join(f"{key}={value}" for key, value in spec.settings.items())
    return (
        spec.method, spec.scenario_id, spec.steps, spec.eval_episodes, spec.cost_limit, spec.cost_signal, settings
    ) == tuple(row[name] for name in _KEY if name != "stage")  # fmt: skip


def _row(address: Address, rows: Sequence[leaderboard.Row]) -> leaderboard.Row:
    """The one row that is meant."""
    wanted = [("method", address.method), ("stage", address.stage), *address.filters]
    for name, _ in wanted:
        if name not in leaderboard.COLUMNS:
            raise UsageError(str(UnknownNameError("column", name, list(leaderboard.COLUMNS))))
    found = [
        row
        for row in rows
        if all(leaderboard.number(row[name]) == value for name, value in wanted)
        and address.scenario in ("", row["scenario"], row["scenario"].rpartition("-v")[0])
    ]
    if not found:
        known = ", ".join(dict.fromkeys(f"{row['method']} {row['stage']} {row['scenario']}" for row in rows))
        raise UsageError(f"{address.text}: no such row in the leaderboard. It has: {known or 'none'}.")
    if len(found) > 1:
        raise UsageError(f"{address.text}: {len(found)} rows; add one of: {'; '.join(_hints(found))}.")
    return found[0]


def _hints(found: Sequence[leaderboard.Row]) -> list[str]:
    """What tells rows apart, as it may be typed."""
    differing = [name for name in _KEY if name != "scenario" and len({row[name] for row in found}) > 1]
    return [" ".join([row["scenario"], *(f"{n}={leaderboard.number(row[n])}" for n in differing)]) for row in found]


def _compute(query: Query, records: Sequence[Record], stage: str) -> float:
    seeds = []
    for record in records:
        table = record.train_episodes() if stage == "T" else record.eval_episodes()
        seeds.append({name: column(table, name).astype(np.float64) for name in query.columns})
    if not any(len(next(iter(columns.values()))) for columns in seeds):
        return math.nan
    return float(query.compute(seeds))


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"


def _stated(path: Path, key: dict[str, str], figure: str) -> str | None:
    """What a CSV file says in the row of a key."""
    if not path.exists():
        return None
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if all(row.get(name) == value for name, value in key.items()):
                return row.get(figure)
    return None


def commit(record: Record) -> str:
    """Commit of a record's code, + where the code differed from it."""
    git = record.details.get("provenance", {}).get("git", {})
    return (git.get("commit") or "unknown") + ("+" if git.get("dirty") else "")


def as_values(found: Trace) -> dict[str, Any]:
    """Plain values."""
    return {
        "cell": found.cell,
        "method": found.method,
        "scenario": found.scenario,
        "stage": found.stage,
        "value": found.value,
        "stated": found.stated,
        "agrees": found.agrees,
        "file": str(found.path),
        "paper": found.paper,
        "reason": found.reason,
        "query": {"formula": found.formula, "columns": list(found.columns), "file": found.file},
        "records": [
            {"record": record.path.name, "seed": record.spec.seed, "commit": commit(record)} for record in found.records
        ],
    }


def _collisions(found: Trace) -> str:
    """Collisions and episodes behind the cell, a zero with its bound; empty without records."""
    if not found.records:
        return ""
    counts = pooled([count_record(record, found.stage) for record in found.records])
    return f"collisions of these policies {format_rate(counts.collision_rate)}" if counts.episodes else ""


def as_text(found: Trace) -> str:
    """For people."""
    if found.stated is None:
        check = f"{found.path} does not hold it: draw it again"
    else:
        check = f"as {found.path} says" if found.agrees else f"{found.path} says {found.stated}: draw it again"
    lines = [
        f"{found.cell}: {found.value or 'empty'} ({check})",
        f"  method   {found.method} on {found.scenario}, stage {found.stage}",
        f"  query    {found.formula}",
        f"  columns  {', '.join(found.columns) or '-'} of {found.file}",
    ]
    entries: list[tuple[str, Callable[[Trace], str]]] = [
        ("counts", _collisions), ("paper", lambda t: t.paper), ("missing", lambda t: t.reason)
    ]  # fmt: skip
    lines += [f"  {name:8} {text(found)}" for name, text in entries if text(found)]
    lines += [f"  seed {r.spec.seed:<3} {r.path.name} at commit {commit(r)}" for r in found.records]
    return "\n".join(lines)
