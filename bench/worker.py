"""A worker process: takes run specifications from a pipe, one after another, and reports on it."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
import sys
import time
from collections.abc import Iterator, Mapping
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


def main(pipe: Connection, results: Path, core: int | None) -> None:
    """Serve until the pipe closes or None comes; SIGTERM stops cleanly, SIGINT is the executor's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    if core is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})
    try:
        _serve(pipe, results)
    finally:
        # All locks and files are given back by now; taking down torch would only cost time.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _serve(pipe: Connection, results: Path) -> None:
    while True:
        try:
            text = pipe.recv()
        except EOFError:
            return
        if text is None:
            return
        _run(pipe, text, results)


def _stop(*_: object) -> None:
    raise SystemExit(128 + signal.SIGTERM)


def _run(pipe: Connection, text: str, results: Path) -> None:
    # Imported here, so that the executor learns of a broken installation as a failed run.
    try:
        from bench import runner
        from bench.errors import AlreadyDoneError, LockedError
        from bench.spec import RunSpec

        spec = RunSpec.model_validate_json(text)
        with _output_to(results / LOGS / f"{spec.folder_name}.log"):
            try:
                runner.run(spec, results, _reporter(pipe))
            except AlreadyDoneError:
                pass
            except LockedError as error:
                _send(pipe, (ENDED, LOCKED, str(error)))
                return
    except Exception as error:
        _send(pipe, (ENDED, FAILED, str(error) or type(error).__name__))
        return
    _send(pipe, (ENDED, DONE, ""))


def _reporter(pipe: Connection) -> Any:
    last_stage, last_sent = "", 0.0

    def report(stage: str, done: int, total: int, scalars: Mapping[str, float]) -> None:
        nonlocal last_stage, last_sent
        now = time.monotonic()
        if stage != last_stage or done >= total or now - last_sent >= REPORT_EVERY_S:
            last_stage, last_sent = stage, now
            _send(pipe, (PROGRESS, stage, done, total, dict(scalars)))

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
