"""One ``bench run``: skip what is done, run the rest, summarise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from bench import leaderboard
from bench.progress import Board, Display, Phase, RunStatus
from bench.records import Record, read_record
from bench.spec import RunSpec
from bench.store import State, Store


@dataclass(frozen=True, slots=True)
class Sweep:
    """What became of the runs.

    Attributes:
        board: Their last statuses.
        rows: Leaderboard rows of those that are done, and of these only.
    """

    board: Board
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
    """Statuses before anything runs: done work is skipped, failed work only retried when asked to."""
    store = Store(results)
    statuses = []
    for spec in specs:
        status = RunStatus(spec)
        state = store.state(spec)
        if state is State.DONE:
            status.end(Phase.SKIPPED)
        elif state is State.FAILED and not retry_failed:
            failure = store.failure(spec)
            status.end(
                Phase.FAILED,
                f"failed before (--retry-failed tries again): {failure.reason if failure else ''}",
            )
        statuses.append(status)
    return Board(statuses, workers)


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
    """Read the records of what is done."""
    store = Store(results)
    done: Sequence[Record] = [
        read_record(store.folder(run.spec)) for run in board.runs if run.phase in (Phase.DONE, Phase.SKIPPED)
    ]
    return Sweep(board, leaderboard.rows(done))
