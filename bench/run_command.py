"""``bench run``: what it prints around a sweep."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bench import leaderboard, sweep
from bench.display import choose_display
from bench.errors import BenchError, UsageError
from bench.estimate import estimate
from bench.executors import LocalExecutor
from bench.leaderboard import Row, collision_text
from bench.progress import Phase, RunStatus, duration
from bench.protocols import Request, expand, split_names
from bench.ray_executor import RayExecutor
from bench.records import Record, collect, collect_readable
from bench.store import FAILED_FILE, Store
from bench.text import columns, json_text
from bench.tracking import require_tracker

EXECUTORS: Final = ("local", "ray")


@dataclass(frozen=True, slots=True)
class Options:
    """How to run, as typed."""

    results: Path
    workers: int | None
    retry_failed: bool
    quiet: bool
    as_json: bool
    executor: str = "local"
    address: str | None = None
    track: str | None = None

    def make_executor(self) -> LocalExecutor | RayExecutor:
        """The executor of these options.

        Raises:
            UsageError: It is unknown, or cannot be used here.
        """
        require_tracker(self.track)
        if self.executor not in EXECUTORS:
            raise UsageError(f"--executor {self.executor}: must be one of {', '.join(EXECUTORS)}.")
        if self.executor == "ray":
            return RayExecutor(self.results, self.workers, self.address, self.track)
        if self.address is not None:
            raise UsageError(f"--address {self.address}: only with --executor ray.")
        return LocalExecutor(self.results, self.workers, self.track)


def run(request: Request, options: Options) -> int:
    """Run a request and print its table; the exit code.

    Raises:
        UsageError: Something in the request or the options cannot be used.
    """
    _require_folder(options.results)
    executor = options.make_executor()
    with executor.ready():
        return _run(request, options, executor)


def _run(request: Request, options: Options, executor: LocalExecutor | RayExecutor) -> int:
    expansion = expand(request)
    board = sweep.plan(expansion.specs, options.results, executor.workers, options.retry_failed)
    _name_unavailable(expansion.unavailable)
    try:
        sweep.execute(board, executor, choose_display(board, options.quiet or options.as_json))
    except KeyboardInterrupt:
        done = board.count(Phase.DONE, Phase.SKIPPED)
        print(
            f"bench: stopped with {done} of {len(board.runs)} runs done. "
            "The same command goes on where this one stopped.",
            file=sys.stderr,
        )
        return 130
    finished = sweep.finish(board, options.results)
    compared = _update_leaderboard(options.results, finished.records)
    text = _as_text(finished, options.results, compared)
    print(_as_json(finished, expansion.unavailable) if options.as_json else text)
    # With `all` an optional package may be missing; who names a method wants that method.
    missing = expansion.unavailable.keys() & set(split_names(request.algo))
    return 1 if finished.failed or missing else 0


def _require_folder(results: Path) -> None:
    """Refuse what can never be a results folder before anything runs: a file, or a path below one."""
    for path in (results, *results.parents):
        if os.path.lexists(path) and not os.path.isdir(path):
            raise UsageError(f"--results {results}: {path} is not a folder; give another name, or move it away.")


def _update_leaderboard(results: Path, known: Sequence[Record]) -> bool:
    """Draw the leaderboard of the whole results folder again, if all is well there: this run is not spoilt if not."""
    try:
        leaderboard.write(results, leaderboard.rows(collect(results, known).records))
        return True
    except BenchError as error:
        print(f"bench: the leaderboard was not written:\n{error}", file=sys.stderr)
    except OSError as error:
        print(
            f"bench: the leaderboard was not written: {results}: {error.strerror or error}: make room there or make "
            f"the folder writable, then type bench leaderboard --results {results}",
            file=sys.stderr,
        )
    return False


def _name_unavailable(unavailable: Mapping[str, str]) -> None:
    for name, reason in unavailable.items():
        print(f"unavailable: {name}: {reason}", file=sys.stderr)


def _as_json(finished: sweep.Sweep, unavailable: Mapping[str, str]) -> str:
    runs = [
        {
            "run": run.spec.folder_name,
            "method": run.spec.method,
            "scenario": run.spec.scenario_id,
            "seed": run.spec.seed,
            "state": str(run.phase),
            "reason": run.reason,
            "seconds": round(run.seconds, 3),
        }
        for run in finished.board.runs
    ]
    return json_text({"runs": runs, "results": finished.rows, "unavailable": dict(unavailable)})


def _as_text(finished: sweep.Sweep, results: Path, compared: bool) -> str:
    parts = [result_table(finished.rows)] if finished.rows else []
    parts += [_failed_line(run, results) for run in finished.failed]
    parts += [f"not run here: {run.spec.label}: {run.reason}" for run in finished.elsewhere]
    parts.append(f"{finished.board.summary()}.")
    table = f"; all of them compared: {results / 'leaderboard.md'}" if compared else ""
    parts.append(f"Records: {results / 'runs'}{table}")
    return "\n".join(parts)


def _failed_line(run: RunStatus, results: Path) -> str:
    more = Store(results).folder(run.spec) / FAILED_FILE
    return f"failed: {run.spec.label}: {run.reason}" + (f" (more: {more})" if more.exists() else "")


def result_table(rows: Sequence[Row]) -> str:
    """T and A for each method, collisions with exact 95 % intervals."""
    heading = ("scenario", "method", "stage", "seeds", "collisions", "speed m/s", "interventions", "return")
    ordered = sorted(rows, key=lambda row: (row["scenario"], row["method"], row["steps"], row["stage"] == "A"))
    return columns(heading, [_cells(row) for row in ordered])


def _cells(row: Row) -> tuple[str, ...]:
    if not row["episodes"]:
        return (
            row["scenario"],
            row["method"],
            row["stage"],
            str(row["seeds"]),
            "no finished episode",
            "",
            "",
            "",
        )
    return (
        row["scenario"],
        row["method"],
        row["stage"],
        str(row["seeds"]),
        collision_text(row),
        f"{row['speed_mps']:.2f}",
        f"{100.0 * row['intervention_ratio']:.2f} %",
        f"{row['return_without_risk']:.1f}",
    )


def dry_run(request: Request, options: Options) -> int:
    """List the runs of a request with their state and the time that they will take; the exit code.

    Raises:
        UsageError: Something in the request or the options cannot be used.
    """
    _require_folder(options.results)
    expansion = expand(request)
    workers = LocalExecutor(options.results, options.workers).workers
    board = sweep.plan(expansion.specs, options.results, workers, options.retry_failed)
    queued = [status.spec for status in board.runs if status.phase is Phase.QUEUED]
    readable, errors = collect_readable(options.results)
    for error in errors:
        print(f"bench: left out of the estimate: {error}", file=sys.stderr)
    times = estimate(queued, readable.records, workers)
    seconds = dict(zip((spec.hash for spec in queued), times.seconds, strict=True))
    listed = [
        {
            "run": status.spec.folder_name,
            "state": str(status.phase),
            "steps": status.spec.steps,
            "eval_episodes": status.spec.eval_episodes,
            "seconds": round(seconds.get(status.spec.hash, 0.0), 1),
            "reason": status.reason,
        }
        for status in board.runs
    ]
    _name_unavailable(expansion.unavailable)
    if options.as_json:
        unavailable = dict(expansion.unavailable)
        print(json_text({"runs": listed, "wall_s": times.wall_s, "basis": times.basis, "unavailable": unavailable}))
        return 0
    rows = [
        (str(item["run"]), str(item["state"]), f"{item['steps']:,}", f"{item['eval_episodes']:,}",
         duration(float(str(item["seconds"]))))
        for item in listed
    ]  # fmt: skip
    print(columns(("run", "state", "steps", "episodes", "time"), rows))
    for status in board.runs:
        if status.phase is Phase.FAILED:
            print(_failed_line(status, options.results))
    print(
        f"{len(queued)} of {len(listed)} runs to do, about {duration(times.wall_s)} "
        f"with {workers} at a time ({times.basis})."
    )
    return 0
