"""Commands that show what happened."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.app import RESULTS, AsJson, Results, app, reports_errors, show

Run = Annotated[
    str,
    typer.Argument(metavar="RUN", help="Part of a run's folder name, or stress:SCENARIO:tc=3.0:driver=random."),
]
Episode = Annotated[
    str, typer.Option(help="Number of the held-out episode; worst: a collision, else the closest call; closest.")
]


@app.command()
@reports_errors
def replay(
    run: Run,
    episode: Episode = "worst",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="x.mp4, x.gif, x.png (five moments) or x.html (a player).")
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="RUN", help="A second run, on the same episode, beside the first.")
    ] = None,
    results: Results = RESULTS,
    as_json: AsJson = False,
) -> None:
    """Drive a held-out episode of a record again, bit for bit, check it against the record, and draw it."""
    from bench.replay import command
    from bench.text import json_text

    if out is not None:
        command.check_suffix(out)
    shown = command.replays(run, episode, against, results)
    written = None if out is None else command.write(shown, out)
    show(json_text(command.as_values(shown)) if as_json else command.as_text(shown))
    if written is not None and not as_json:
        show(written)


@app.command()
@reports_errors
def report(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where index.html goes; made if missing.")],
    results: Results = RESULTS,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, only the result.")] = False,
) -> None:
    """Write one self-contained page with every figure, chart and replay: DIR/index.html."""
    from bench.display import Steps
    from bench.records import collect
    from bench.report import page

    collection = collect(results)
    with Steps("replays", len(collection.records), quiet) as steps:
        path = page.write(collection, out, results / "cache", steps.begin)
    show(f"{path}: {path.stat().st_size / 1e6:.1f} MB, {len(collection.records)} runs")
