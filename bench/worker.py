"""A worker process: takes run specifications from a pipe, one after another, and reports on it."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

ONE_THREAD: Final = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Two OpenMP threads on one core made 100 updates a second into 1."""
REPORT_EVERY_S: Final = 0.25
LOGS: Final = "logs"
"""Folder for what failed runs printed."""

# Messages to the executor: (kind, ...).
PROGRESS: Final = "progress"
"""stage, done, total, scalars."""
ENDED: Final = "ended"
"""outcome (`DONE`, `FAILED` or `LOCKED`), reason."""
DONE: Final = "done"
FAILED: Final = "failed"
LOCKED: Final = "locked"


def main(pipe: Connection, results: Path, core: int | None, track: str | None = None) -> None:
    """Serve until the pipe closes or None comes; SIGTERM stops cleanly, SIGINT is the executor's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    if core is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})
    try:
        _serve(pipe, results, track)
    finally:
        # All locks and files are given back by now; taking down torch would only cost time.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _serve(pipe: Connection, results: Path, track: str | None) -> None:
    while True:
        try:
            text = pipe.recv()
        except EOFError:
            return
        if text is None:
            return
        _run(pipe, text, results, track)


def _stop(*_: object) -> None:
    raise SystemExit(128 + signal.SIGTERM)


def _run(pipe: Connection, text: str, results: Path, track: str | None) -> None:
    _send(pipe, (ENDED, *run_one(text, results, lambda *progress: _send(pipe, (PROGRESS, *progress)), track)))


def run_one(
    text: str, results: Path, send: Callable[[str, int, int, dict[str, float]], None], track: str | None = None
) -> tuple[str, str]:
    """Run one specification in this process; its outcome (`DONE`, `FAILED` or `LOCKED`) and reason.

    Args:
        text: JSON of a `RunSpec`.
        results: The results folder.
        send: Told of stage, amount done, amount in all and scalars, four times a second at most.
        track: Where else scalars go, see `bench.tracking`.
    """
    # Imported here, so that the executor learns of a broken installation as a failed run.
    try:
        from bench import runner
        from bench.errors import AlreadyDoneError, LockedError
        from bench.spec import RunSpec
        from bench.tracking import tracked

        spec = RunSpec.model_validate_json(text)
        with _output_to(results / LOGS / f"{spec.folder_name}.log"):
            try:
                with tracked(track, spec, results, _reporter(send)) as report:
                    runner.run(spec, results, report)
            except AlreadyDoneError:
                pass
            except LockedError as error:
                return LOCKED, str(error)
    except Exception as error:
        return FAILED, str(error) or type(error).__name__
    return DONE, ""


def _reporter(send: Callable[[str, int, int, dict[str, float]], None]) -> Any:
    last_stage, last_sent = "", 0.0

    def report(stage: str, done: int, total: int, scalars: Mapping[str, float]) -> None:
        nonlocal last_stage, last_sent
        now = time.monotonic()
        if stage != last_stage or done >= total or now - last_sent >= REPORT_EVERY_S:
            last_stage, last_sent = stage, now
            send(stage, done, total, dict(scalars))

    return report


def _send(pipe: Connection, message: tuple[Any, ...]) -> None:
    try:
        pipe.send(message)
    except OSError:
        # The executor is gone: stop as if it had said so, and leave no FAILED behind.
        raise SystemExit(1) from None


@contextlib.contextmanager
def _output_to(path: Path) -> Iterator[None]:
    """Send what a run prints to a file; the file of a run that succeeds is removed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = os.dup(1), os.dup(2)
    with path.open("w") as log:
        sys.stdout.flush()
        sys.stderr.flush()
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        faulthandler.enable()
        try:
            yield
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os.dup2(kept[0], 1)
            os.dup2(kept[1], 2)
            os.close(kept[0])
            os.close(kept[1])
    path.unlink(missing_ok=True)
