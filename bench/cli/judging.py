"""Commands that read records."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.app import RESULTS, AsJson, Results, app, reports_errors, show
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.records import Collection


@app.command()
@reports_errors
def leaderboard(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Write leaderboard.csv, improvement.csv and the same as .md, from the records alone."""
    from bench import improvement
    from bench import leaderboard as board
    from bench.text import json_text

    collection = _collected(results)
    ranked = board.rows(collection.records)
    paths = [*board.write(results, ranked), *improvement.write(results, improvement.rows(collection))]
    show(json_text(ranked) if as_json else f"{len(ranked)} rows: {', '.join(map(str, paths))}")


@app.command()
@reports_errors
def tables(
    results: Results = RESULTS,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to; paper_tables/, or DIR/paper_tables of other --results."),
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Only runs of this training budget.")] = None,
    as_json: AsJson = False,
) -> None:
    """Write the paper's two tables beside ours, from the records alone; prints their paths."""
    from bench import tables as drawn

    collection = _collected(results)
    budgets = sorted({record.spec.steps for record in collection.records if record.spec.steps})
    if steps is not None and steps not in budgets:
        raise UsageError(f"--steps {steps}: no finished run has this budget; there are: {budgets}.")
    _show_paths(drawn.write(collection, out or _tables_folder(results), steps), as_json)


@app.command()
@reports_errors
def claims(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Test the paper's claims C1 to C5 on the records, and write claims.json; rules in docs/claims.md."""
    from bench import claims as tested
    from bench.text import json_text

    found = tested.judge(_collected(results))
    path = tested.write(results, found)
    show(json_text(tested.as_values(found)) if as_json else f"{tested.as_text(found)}\n\n{path}")


@app.command()
@reports_errors
def plot(
    results: Results = RESULTS,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where to; plots/ in the results folder.")] = None,
    as_json: AsJson = False,
) -> None:
    """Draw every figure that the records allow, as PDF and PNG; prints their paths."""
    from bench import plots

    _show_paths(plots.write(_collected(results), out or results / "plots", _note), as_json)


@app.command()
@reports_errors
def why(
    table: Annotated[str, typer.Argument(metavar="TABLE", help="ablation, collision or leaderboard.")],
    cell: Annotated[
        list[str],
        typer.Argument(metavar="CELL", help="METHOD FIGURE STAGE; leaderboard: then [SCENARIO] [COLUMN=VALUE ...]."),
    ],
    results: Results = RESULTS,
    as_json: AsJson = False,
) -> None:
    """Name the records, seeds, commits and query behind a cell, and compute it again from them.

    As in: bench why ablation dd-rq "Collision Rate" A. Ends with 1 if the written table says something else.
    """
    from bench import why as traced
    from bench.text import json_text

    address = traced.parse(table, cell)
    found = traced.trace(address, _collected(results), results if table == "leaderboard" else _tables_folder(results))
    show(json_text(traced.as_values(found)) if as_json else traced.as_text(found))
    raise typer.Exit(0 if found.agrees else 1)


def _tables_folder(results: Path) -> Path:
    return Path("paper_tables") if results == RESULTS else results / "paper_tables"


def _collected(results: Path) -> Collection:
    """What a results folder holds; runs without a finished record are named, as nothing drawn shows them."""
    from bench.records import collect_existing

    collection = collect_existing(results)
    for run in collection.missing:
        _note(f"bench: left out, {run.spec.label}: {run.reason}.")
    return collection


def _note(text: str) -> None:
    print(text, file=sys.stderr)


def _show_paths(paths: Iterable[Path], as_json: bool) -> None:
    from bench.text import json_text

    written = [str(path) for path in paths]
    show(json_text(written) if as_json else "\n".join(written))
