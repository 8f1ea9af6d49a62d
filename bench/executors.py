"""Executors: many runs on local processes, one thread and one core each; no run can stop another."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

from bench import worker
from bench.fork_server import await_fork_server, deaf_to_interrupts, one_thread, warm_up
from bench.progress import Board, Display, Phase, RunStatus
from bench.provenance import usable_cores
from bench.store import Failure, State, Store

STOP_S: Final = 2.0
"""Time that workers get to stop before they are killed; together within 5 s."""
TICK_S: Final = 0.2
OUTCOMES: Final = {worker.DONE: Phase.DONE, worker.LOCKED: Phase.ELSEWHERE, worker.FAILED: Phase.FAILED}
"""What a worker says of a run, as its phase."""


@dataclass(slots=True)
class _Worker:
    process: BaseProcess
    pipe: Connection
    core: int | None
    run: RunStatus | None = None


class LocalExecutor:
    """Runs specifications on processes of this machine.

    Args:
        results: The results folder.
        workers: Processes at a time; by default one for each usable core.
        track: Where else scalars go, see `bench.tracking`.
    """

    def __init__(self, results: Path, workers: int | None = None, track: str | None = None) -> None:
        self.workers = workers or usable_cores()
        self._track = track
        self._results = results
        self._store = Store(results)
        self._context = multiprocessing.get_context("forkserver")
        self._pool: list[_Worker] = []

    @contextlib.contextmanager
    def ready(self) -> Iterator[None]:
        """Start what workers are forked from, while the caller finds out what to run."""
        warm_up()
        yield

    def _fill(self, count: int) -> None:
        missing = count - len(self._pool)
        if missing > 0:
            cores = self._cores(count)[-missing:]  # measures load for 0.1 s, while the fork server imports
            await_fork_server()
            self._pool += [self._start(core) for core in cores]

    def execute(self, board: Board, display: Display) -> None:
        """Run every queued run of the board to its end.

        Raises:
            KeyboardInterrupt: Ctrl-C; the workers have stopped, their runs go on where they were.
        """
        queue = deque(run for run in board.runs if run.phase is Phase.QUEUED)
        try:
            warm_up()
            self._fill(min(self.workers, len(queue)))
            while queue or any(member.run for member in self._pool):
                self._hand_out(queue, display)
                self._listen(display)
                display.refresh()
        finally:
            self._stop()

    def _cores(self, count: int) -> Sequence[int | None]:
        """Cores for workers, least busy first; a single process is left to the scheduler."""
        if count < 2 or not hasattr(os, "sched_getaffinity"):
            return [None] * count
        import psutil

        load = psutil.cpu_percent(interval=0.1, percpu=True)
        cores = sorted(os.sched_getaffinity(0), key=lambda core: load[core] if core < len(load) else 0.0)
        return [cores[i % len(cores)] for i in range(count)]

    def _start(self, core: int | None) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=worker.main, args=(theirs, self._results, core, self._track), name="bench-worker", daemon=False
        )
        with one_thread(), deaf_to_interrupts():
            process.start()
        theirs.close()
        return _Worker(process, ours, core)

    def _hand_out(self, queue: deque[RunStatus], display: Display) -> None:
        for place, member in enumerate(self._pool):
            if member.run is not None or not queue:
                continue
            if not member.process.is_alive():
                self._pool[place] = member = self._start(member.core)
            run = queue.popleft()
            run.start(member.process.pid or 0)
            member.run = run
            with contextlib.suppress(OSError):  # a worker that has just died is noticed by `_listen`
                member.pipe.send(run.spec.model_dump_json())
            display.changed(run)

    def _listen(self, display: Display) -> None:
        """Wait a moment for messages and deaths of busy workers."""
        busy = {id(member.pipe): member for member in self._pool if member.run is not None}
        for pipe in wait([member.pipe for member in busy.values()], timeout=TICK_S):
            member = busy[id(pipe)]
            try:
                message = member.pipe.recv()
            except (EOFError, OSError):
                self._bury(member, display)
            else:
                self._take(member, message, display)

    def _take(self, member: _Worker, message: tuple[Any, ...], display: Display) -> None:
        run = member.run
        assert run is not None
        if message[0] == worker.PROGRESS:
            run.advance(*message[1:])
            return
        run.end(OUTCOMES[message[1]], message[2])
        if run.phase is Phase.FAILED and self._store.state(run.spec) is not State.FAILED:
            self._mark_failed(run, run.reason)
        member.run = None
        display.changed(run)

    def _bury(self, member: _Worker, display: Display) -> None:
        """A worker died in the middle of a run: the run has failed, the rest goes on."""
        run = member.run
        assert run is not None
        member.process.join(timeout=STOP_S)
        reason = f"worker process {death(member.process.exitcode)}"
        self._mark_failed(run, reason)
        run.end(Phase.FAILED, reason)
        member.run = None
        display.changed(run)

    def _mark_failed(self, run: RunStatus, reason: str) -> None:
        """Leave FAILED for a run whose worker could not; where the disk refuses, the board still says so."""
        step = run.done if run.stage == "train" else 0
        with contextlib.suppress(OSError):
            self._store.fail(run.spec, Failure("worker", step, reason))

    def _stop(self) -> None:
        """End all workers: by SIGTERM, deaf ones by SIGKILL."""
        with deaf_to_interrupts():
            for member in self._pool:
                member.process.terminate()
                member.pipe.close()
            deadline = time.monotonic() + STOP_S
            for member in self._pool:
                member.process.join(timeout=max(0.0, deadline - time.monotonic()))
                if member.process.is_alive():
                    member.process.kill()
                    member.process.join()
            self._pool.clear()
            with contextlib.suppress(OSError):  # it stays while it holds a log
                (self._results / worker.LOGS).rmdir()


def death(exit_code: int | None) -> str:
    """How a process ended, for people."""
    if exit_code is not None and exit_code < 0:
        name = signal.Signals(-exit_code).name
        return f"was killed by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
    return f"ended with exit code {exit_code}"
