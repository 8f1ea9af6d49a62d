"""One ``bench run``: skip what is done, run the rest, summarise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from bench import leaderboard, store
from bench.errors import RecordError
from bench.progress import Board, Display, Phase, RunStatus
from bench.records import Record, read_record
from bench.spec import RunSpec
from bench.store import State, Store


@dataclass(frozen=True, slots=True)
class Sweep:
    """What became of the runs.

    Attributes:
        board: Their last statuses.
        records: Of those that are done, and of these only.
        rows: Their rows of the leaderboard.
    """

    board: Board
    records: list[Record]
    rows: list[leaderboard.Row]

    @property
    def failed(self) -> list[RunStatus]:
        """Runs that failed, now or before."""
        return [run for run in self.board.runs if run.phase is Phase.FAILED]

    @property
    def elsewhere(self) -> list[RunStatus]:
        """Runs that another process works on."""
        return [run for run in self.board.runs if run.phase is Phase.ELSEWHERE]


def plan(specs: Iterable[RunSpec], results: Path, workers: int, retry_failed: bool = False) -> Board:
    """Statuses before anything runs: done work is skipped, failed work only retried when asked to.

    A record that cannot be read is a failed run, which the user has to remove: nothing that is done is changed.
    """
    return Board([_planned(spec, Store(results), retry_failed) for spec in specs], workers)


def _planned(spec: RunSpec, runs: Store, retry_failed: bool) -> RunStatus:
    status = RunStatus(spec)
    state = runs.state(spec)
    try:
        if state is State.DONE:
            record = read_record(runs.folder(spec))
            for name in (store.TRAIN_FILE, store.EVAL_FILE):
                record.sealed(name)
            status.end(Phase.SKIPPED)
        elif state is State.FAILED and not retry_failed:
            failure = runs.failure(spec)
            status.end(
                Phase.FAILED,
                f"failed before (--retry-failed tries again): {failure.reason if failure else ''}",
            )
    except RecordError as error:
        status.end(Phase.FAILED, _damaged(runs.folder(spec), error))
    return status


def _damaged(folder: Path, error: RecordError) -> str:
    return f"{error} Folder: {folder}"


class Executor(Protocol):
    """Carries out what is queued."""

    def execute(self, board: Board, display: Display) -> None:
        """Run every queued run of the board to its end."""


def execute(board: Board, executor: Executor, display: Display) -> None:
    """Run what is queued.

    Raises:
        KeyboardInterrupt: Ctrl-C; all workers have stopped.
    """
    with display:
        executor.execute(board, display)


def finish(board: Board, results: Path) -> Sweep:
    """Read the records of what is done; one that cannot be used is a failed run and withholds no other."""
    done: list[Record] = []
    for run in board.runs:
        if run.phase in (Phase.DONE, Phase.SKIPPED):
            folder = Store(results).folder(run.spec)
            try:
                record = read_record(folder)
                leaderboard.rows([record])  # counts are kept: they are not made twice
                done.append(record)
            except RecordError as error:
                run.phase, run.reason = Phase.FAILED, _damaged(folder, error)
    return Sweep(board, done, leaderboard.rows(done))
