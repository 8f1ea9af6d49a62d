"""Commands that show what happened."""

from __future__ import annotations

import glob
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.app import RESULTS, AsJson, Results, app, reports_errors, show


def _run_names(incomplete: str) -> list[str]:
    """For the shell's completion: runs of the default results folder."""
    runs = RESULTS / "runs"
    return sorted(path.name for path in runs.glob(f"{glob.escape(incomplete)}*")) if runs.is_dir() else []


Run = Annotated[
    str,
    typer.Argument(
        metavar="RUN",
        help="Part of a run's folder name, or stress:SCENARIO:tc=3.0:driver=random.",
        autocompletion=_run_names,
    ),
]
Against = Annotated[
    str | None,
    typer.Option(metavar="RUN", help="A second run, on the same episode, beside the first.", autocompletion=_run_names),
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
    against: Against = None,
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
def watch(run: Run, episode: Episode = "worst", against: Against = None, results: Results = RESULTS) -> None:
    """Play a held-out episode in the terminal, in real time; Ctrl-C ends it."""
    from rich.console import Console

    from bench.replay import command
    from bench.replay.watch import watch as play

    play(command.replays(run, episode, against, results), Console(highlight=False))


@app.command()
@reports_errors
def report(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where index.html goes; made if missing.")],
    results: Results = RESULTS,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, only the result.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write one self-contained page with every figure, chart and replay: DIR/index.html."""
    from bench.display import Steps
    from bench.records import collect_existing
    from bench.report import page
    from bench.text import json_text

    collection = collect_existing(results)
    with Steps("replays", len(collection.records), quiet or as_json) as steps:
        path = page.write(collection, out, results / "cache", steps.begin)
    size, runs = path.stat().st_size, len(collection.records)
    written = {"path": str(path), "bytes": size, "runs": runs}
    show(json_text(written) if as_json else f"{path}: {size / 1e6:.1f} MB, {runs} runs")
