"""Commands that read records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.app import RESULTS, AsJson, Results, app, reports_errors, show


@app.command()
@reports_errors
def leaderboard(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Write leaderboard.csv and leaderboard.md from the records alone."""
    from bench import leaderboard as board
    from bench.records import collect
    from bench.text import json_text

    ranked = board.rows(collect(results).records)
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
    from bench.records import collect

    folder = out or (Path("paper_tables") if results == RESULTS else results / "paper_tables")
    for path in drawn.write(collect(results), folder, steps):
        show(str(path))
