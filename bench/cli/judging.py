"""Commands that read records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.app import RESULTS, AsJson, Results, app, reports_errors, show
from bench.errors import UsageError


@app.command()
@reports_errors
def leaderboard(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Write leaderboard.csv and leaderboard.md from the records alone."""
    from bench import leaderboard as board
    from bench.records import collect_existing
    from bench.text import json_text

    ranked = board.rows(collect_existing(results).records)
    csv_path, markdown_path = board.write(results, ranked)
    show(json_text(ranked) if as_json else f"{len(ranked)} rows: {csv_path} and {markdown_path}")


@app.command()
@reports_errors
def tables(
    results: Results = RESULTS,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to; paper_tables/, or DIR/paper_tables of other --results."),
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Only runs of this training budget.")] = None,
) -> None:
    """Write the paper's two tables beside ours, from the records alone."""
    from bench import tables as drawn
    from bench.records import collect_existing

    collection = collect_existing(results)
    budgets = sorted({record.spec.steps for record in collection.records if record.spec.steps})
    if steps is not None and steps not in budgets:
        raise UsageError(f"--steps {steps}: no finished run has this budget; there are: {budgets}.")
    for path in drawn.write(collection, out or _tables_folder(results), steps):
        show(str(path))


@app.command()
@reports_errors
def claims(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Test the paper's claims C1 to C5 on the records, and write claims.json; rules in docs/claims.md."""
    from bench import claims as tested
    from bench.records import collect_existing
    from bench.text import json_text

    found = tested.judge(collect_existing(results))
    path = tested.write(results, found)
    show(json_text(tested.as_values(found)) if as_json else f"{tested.as_text(found)}\n\n{path}")


@app.command()
@reports_errors
def plot(
    results: Results = RESULTS,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where to; plots/ in the results folder.")] = None,
) -> None:
    """Draw every figure that the records allow, as PDF and PNG."""
    from bench import plots
    from bench.records import collect_existing

    for path in plots.write(collect_existing(results), out or results / "plots", show):
        show(str(path))


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
    from bench.records import collect_existing
    from bench.text import json_text

    address = traced.parse(table, cell)
    found = traced.trace(
        address, collect_existing(results), results if table == "leaderboard" else _tables_folder(results)
    )
    show(json_text(traced.as_values(found)) if as_json else traced.as_text(found))
    raise typer.Exit(0 if found.agrees else 1)


def _tables_folder(results: Path) -> Path:
    return Path("paper_tables") if results == RESULTS else results / "paper_tables"
