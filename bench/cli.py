"""The command line: parse, call, print. Everything heavy is imported inside the commands."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, ParamSpec, TypeVar

import typer

from bench.errors import BenchError

P = ParamSpec("P")
T = TypeVar("T")

INTERRUPTED: Final = 130

app = typer.Typer(
    name="bench",
    help="Safe reinforcement learning for driving: run methods on constrained scenarios and compare them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: rich's takes longer to import than everything else
    context_settings={"help_option_names": ["-h", "--help"]},
)
speed_app = typer.Typer(help="Measure speed on this machine.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(speed_app, name="speed")
stress_app = typer.Typer(help="Try to make a guard fail.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(stress_app, name="stress")
train_app = typer.Typer(help="Train what runs share.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(train_app, name="train")

Results = Annotated[Path, typer.Option("--results", metavar="DIR", help="Results folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON value instead of text.")]
RESULTS: Final = Path("results")


def reports_errors(command: Callable[P, T]) -> Callable[P, T]:
    """Turn expected errors into a message on standard error and an exit code, without a traceback."""

    @functools.wraps(command)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return command(*args, **kwargs)
        except BenchError as error:
            print(f"bench: {error}", file=sys.stderr)
            raise typer.Exit(error.exit_code) from None
        except KeyboardInterrupt:
            print("bench: interrupted.", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from None

    return wrapper


@app.command()
@reports_errors
def run(
    algo: Annotated[str, typer.Option(help="Methods, as in sac,safety-guard:tc=1.0; or all.")] = "all",
    scenario: Annotated[str, typer.Option(help="Scenarios, as in a,b:decision_period_s=0.1.")] = "a",
    protocol: Annotated[str, typer.Option(help="smoke, quick, standard or paper.")] = "quick",
    seeds: Annotated[str | None, typer.Option(help="How many (5 is 0 to 4), or which: 0,1,7.")] = None,
    steps: Annotated[int | None, typer.Option(help="Training budget in simulation steps of 0.1 s.")] = None,
    eval_episodes: Annotated[int | None, typer.Option(help="Held-out episodes for each seed.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="As cost.limit=0.1; repeatable.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Runs at a time; one for each core.")] = None,
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
    options = run_command.Options(results, workers, retry_failed, quiet, as_json)
    code = run_command.dry_run(request, options) if dry_run else run_command.run(request, options)
    raise typer.Exit(code)


@app.command("list")
@reports_errors
def list_(as_json: AsJson = False) -> None:
    """List methods and scenarios, also those that cannot be used here, with the reason."""
    from bench import listing

    _print(listing.as_json() if as_json else listing.as_text())


@app.command()
@reports_errors
def leaderboard(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Write leaderboard.csv and leaderboard.md from the records alone."""
    from bench import leaderboard as board
    from bench.records import collect
    from bench.text import json_text

    ranked = board.rows(collect(results).records)
    csv_path, markdown_path = board.write(results, ranked)
    _print(json_text(ranked) if as_json else f"{len(ranked)} rows: {csv_path} and {markdown_path}")


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
        _print(str(path))


@speed_app.command()
@reports_errors
def engine(
    scenario: Annotated[str, typer.Option(help="Scenario to step.")] = "a",
    worlds: Annotated[int, typer.Option(min=1, help="Worlds stepped together.")] = 64,
    repeats: Annotated[int, typer.Option(min=5, help="Medians are over so many.")] = 7,
    as_json: AsJson = False,
) -> None:
    """Measure world-steps per second of the engine against highway-env, in this process, on one core."""
    from bench import speed
    from bench.text import json_text

    measured = speed.engine(scenario, worlds, repeats)
    _print(json_text(measured) if as_json else speed.as_text(measured))


@speed_app.command()
@reports_errors
def learner(
    repeats: Annotated[int, typer.Option(min=3, help="Medians are over so many.")] = 7,
    as_json: AsJson = False,
) -> None:
    """Measure updates per second of the SAC learner against stable-baselines3's, in this process, on one thread."""
    from bench import speed_learner
    from bench.text import json_text

    measured = speed_learner.learner(repeats)
    _print(json_text(measured) if as_json else speed_learner.as_text(measured))


@stress_app.command()
@reports_errors
def guard(
    scenario: Annotated[str, typer.Option(help="Scenario to drive.")] = "a",
    tc: Annotated[str, typer.Option(help="T_c in seconds, or dd-rq for that of the risk model.")] = "3.0",
    episodes: Annotated[int, typer.Option(min=1, help="How many.")] = 10_000,
    driver: Annotated[str, typer.Option(help="random, cruise, full-throttle or full-throttle-lane-change.")] = "random",
    seed: Annotated[int, typer.Option(help="Names the stream of episodes.")] = 0,
    agent_steps: Annotated[int, typer.Option(help="dd-rq: budget of the driving agent behind its model.")] = 500_000,
    results: Results = RESULTS,
    as_json: AsJson = False,
) -> None:
    """Drive many episodes behind the safety guard and count collisions by kind and fault."""
    from bench import stress
    from bench.text import json_text

    found = stress.command(scenario, tc, episodes, driver, seed, agent_steps, results / "cache").as_json()
    _print(json_text(found) if as_json else "\n".join(f"{key:20} {value}" for key, value in found.items()))


@train_app.command("driving-agent")
@reports_errors
def driving_agent(
    scenario: Annotated[str, typer.Option(help="Scenario to train on.")] = "a",
    steps: Annotated[int, typer.Option(min=1, help="Budget in simulation steps of 0.1 s.")] = 500_000,
    results: Results = RESULTS,
) -> None:
    """Train the driving agent pi_phi, or find it in the cache; its learning curve is in agent.json beside it."""
    from bench import training

    _print(str(training.train_driving_agent(scenario, steps, results / "cache", _print)))


@app.command()
@reports_errors
def doctor(results: Results = RESULTS, as_json: AsJson = False) -> None:
    """Check what runs need on this machine, and say how to mend what is missing."""
    from bench import doctor as checks
    from bench.text import json_text

    found = checks.examine(results)
    _print(json_text(checks.as_values(found)) if as_json else checks.as_text(found))
    raise typer.Exit(0 if checks.healthy(found) else 1)


def _print(text: Any) -> None:
    print(text, flush=True)


def main() -> None:
    """Entry point of the console script."""
    app()
