"""Commands that run methods, and what runs need."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from bench.cli.app import RESULTS, AsJson, Results, app, group, reports_errors, show

train_app = group("train", "Train what runs share.")


@app.command()
@reports_errors
def run(
    algo: Annotated[str, typer.Option(help="Methods, as in all,safety-guard:tc=1.0.")] = "all",
    scenario: Annotated[str, typer.Option(help="Scenarios, as in a,b:decision_period_s=0.1.")] = "a",
    protocol: Annotated[str, typer.Option(help="smoke, quick, standard or paper.")] = "quick",
    seeds: Annotated[str | None, typer.Option(help="How many (5 is 0 to 4), or which: 0,1,7; only one: 7,")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Training budget in simulation steps of 0.1 s.")] = None,
    eval_episodes: Annotated[int | None, typer.Option(min=1, help="Held-out episodes for each seed.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="As cost.limit=0.1; repeatable.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Runs at a time; one for each core.")] = None,
    executor: Annotated[str, typer.Option(help="local, or ray for a cluster.")] = "local",
    address: Annotated[str | None, typer.Option(help="Of the Ray cluster; one is started here without.")] = None,
    track: Annotated[str | None, typer.Option(help="Scalars live in tensorboard or mlflow.")] = None,
    results: Results = RESULTS,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run failed work again.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the runs and their time.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, only the result.")] = False,
    as_json: AsJson = False,
) -> None:
    """Train and evaluate methods; what is done already is not done again."""
    from bench import run_command
    from bench.protocols import Request

    request = Request(algo, scenario, protocol, seeds, steps, eval_episodes, settings or [])
    options = run_command.Options(results, workers, retry_failed, quiet, as_json, executor, address, track)
    code = run_command.dry_run(request, options) if dry_run else run_command.run(request, options)
    raise typer.Exit(code)


@app.command()
@reports_errors
def rerun(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Folder of a finished run, or part of its name.")],
    results: Results = RESULTS,
    as_json: AsJson = False,
) -> None:
    """Repeat a finished run and compare the bytes of its record; exit code 1 where they differ."""
    from bench import rerun as again
    from bench.records import find_record
    from bench.text import json_text

    record = find_record(results, run)
    for note in again.other_code(record):
        print(f"bench: {note}.", file=sys.stderr)
    found = again.repeat(record, results, quiet=as_json)
    show(json_text(again.as_values(found)) if as_json else again.as_text(record, found))
    raise typer.Exit(1 if found else 0)


@train_app.command("driving-agent")
@reports_errors
def driving_agent(
    scenario: Annotated[str, typer.Option(help="Scenario to train on.")] = "a",
    steps: Annotated[int, typer.Option(min=1, help="Budget in simulation steps of 0.1 s.")] = 500_000,
    results: Results = RESULTS,
) -> None:
    """Train the driving agent pi_phi, or find it in the cache; its learning curve is in agent.json beside it."""
    from bench import training

    show(str(training.train_driving_agent(scenario, steps, results / "cache", show)))


@app.command()
@reports_errors
def doctor(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Check what runs need on this machine, and say how to mend what is missing."""
    from bench import doctor as checks
    from bench.text import json_text

    found = checks.examine(results)
    show(json_text(checks.as_values(found)) if as_json else checks.as_text(found))
    raise typer.Exit(0 if checks.healthy(found) else 1)
