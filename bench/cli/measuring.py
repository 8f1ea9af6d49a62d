"""Commands that measure speed and stress guards."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.app import RESULTS, AsJson, Results, group, reports_errors, show

speed_app = group("speed", "Measure speed on this machine.")
stress_app = group("stress", "Try to make a guard fail.")
risk_app = group("risk", "Look into the risk models.")


@speed_app.command()
@reports_errors
def engine(
    scenario: Annotated[str, typer.Option(help="Scenario to step.")] = "a",
    worlds: Annotated[int, typer.Option(min=1, help="Worlds stepped together.")] = 64,
    repeats: Annotated[int, typer.Option(min=5, help="Medians are over so many.")] = 7,
    as_json: AsJson = False,
) -> None:
    """Measure world-steps per second of the engine against highway-env, in this process, on one core."""
    from bench.speed import engine as speed
    from bench.text import json_text

    measured = speed.engine(scenario, worlds, repeats)
    show(json_text(measured) if as_json else speed.as_text(measured))


@speed_app.command()
@reports_errors
def learner(
    repeats: Annotated[int, typer.Option(min=3, help="Medians are over so many.")] = 7,
    as_json: AsJson = False,
) -> None:
    """Measure updates per second of the SAC learner against stable-baselines3's, in this process, on one thread."""
    from bench.speed import learner as speed
    from bench.text import json_text

    measured = speed.learner(repeats)
    show(json_text(measured) if as_json else speed.as_text(measured))


@speed_app.command()
@reports_errors
def risk(
    repeats: Annotated[int, typer.Option(min=3, help="Medians are over so many.")] = 7,
    as_json: AsJson = False,
) -> None:
    """Measure the risk model's time for the scenes of 64 and 256 worlds, in this process, on one thread."""
    from bench.speed import risk as speed
    from bench.text import json_text

    measured = speed.risk(repeats)
    show(json_text(measured) if as_json else speed.as_text(measured))


@risk_app.command()
@reports_errors
def report(
    scenario: Annotated[str, typer.Option(help="Scenario of the models.")] = "a",
    agent_steps: Annotated[int, typer.Option(min=1, help="Budget of the driving agent behind them.")] = 500_000,
    results: Results = RESULTS,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where it goes; a folder in RESULTS/risk by default.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Judge the risk models of dd-rq and dd-rq-plus by roll-outs of their driving agent; train what is missing."""
    from bench.risk import report as risk_report
    from bench.text import json_text

    folder = out or results / "risk" / f"{scenario}-{agent_steps}"
    found = risk_report.command(scenario, agent_steps, results / "cache", folder)
    show(json_text(found) if as_json else f"{risk_report.as_markdown(found)}\nWritten: {folder}")


@stress_app.command()
@reports_errors
def guard(
    scenario: Annotated[str, typer.Option(help="Scenario to drive.")] = "a",
    tc: Annotated[str, typer.Option(help="T_c in seconds, or dd-rq for that of the risk model.")] = "3.0",
    episodes: Annotated[int, typer.Option(min=1, help="How many.")] = 10_000,
    driver: Annotated[str, typer.Option(help="random, cruise, full-throttle or full-throttle-lane-change.")] = "random",
    seed: Annotated[int, typer.Option(help="Names the stream of episodes.")] = 0,
    agent_steps: Annotated[int, typer.Option(help="dd-rq: budget of the driving agent behind its model.")] = 500_000,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="OPTION=BOOL", help="As reserve=false; repeatable.")
    ] = None,
    results: Results = RESULTS,
    as_json: AsJson = False,
) -> None:
    """Drive many episodes behind the safety guard and count collisions by kind and fault."""
    from bench import stress
    from bench.text import json_text

    cache = results / "cache"
    found = stress.command(scenario, tc, episodes, driver, seed, agent_steps, cache, settings or []).as_json()
    show(json_text(found) if as_json else "\n".join(f"{key:20} {value}" for key, value in found.items()))


@stress_app.command()
@reports_errors
def record(
    only: Annotated[str | None, typer.Option(help="random-actions, variants or ablation; all by default.")] = None,
    episodes: Annotated[int | None, typer.Option(min=1, help="Of each case, instead of its own number.")] = None,
    agent_steps: Annotated[int, typer.Option(help="dd-rq: budget of the driving agent behind its model.")] = 500_000,
    results: Results = RESULTS,
) -> None:
    """Run what is missing among the stress cases of docs/guard.md, half an hour in all; RESULTS/stress keeps them."""
    from bench import figures_guard

    for line in figures_guard.command(results, only, episodes, agent_steps):
        show(line)


@stress_app.command()
@reports_errors
def tables(results: Results = RESULTS) -> None:
    """Print the tables of docs/guard.md from the records in RESULTS/stress."""
    from bench import figures_guard

    for name in figures_guard.CASES:
        show(f"{figures_guard.table(results / 'stress', name)}\n")


@speed_app.command()
@reports_errors
def protocol(
    algo: Annotated[str, typer.Option(help="Methods, or all.")] = "all",
    scenario: Annotated[str, typer.Option(help="Scenario.")] = "a",
    steps: Annotated[int | None, typer.Option(help="Training budget; that of the quick protocol.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure where the time of a quick run of each method goes: engine, guard, risk model, policy, update, store."""
    from bench.protocols import Request
    from bench.speed import protocol as speed
    from bench.text import json_text

    measured = speed.protocol(Request(algo, scenario, "quick", "1", steps))
    show(json_text(measured) if as_json else speed.as_text(measured))
