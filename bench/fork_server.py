"""The process that workers are forked from. Nothing heavy is imported here: a command can start it before all else."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Mapping
from multiprocessing import forkserver, resource_tracker
from typing import Final

from bench.worker import ONE_THREAD

SINGLE: Final = dict.fromkeys(ONE_THREAD, "1")
PARENT: Final = "SAFEDRIVE_BENCH_PARENT"
"""Environment variable with the process that starts the one that workers are forked from."""


def warm_up() -> None:
    """Start the process that workers are forked from: it imports their packages, seconds long, on its own.

    It ends with the process that started it, at the latest when its imports are done; nobody waits for it.
    """
    multiprocessing.get_context("forkserver").set_forkserver_preload(["bench.preload"])
    resource_tracker.ensure_running()  # where the fork server starts it, it lets interrupts through again
    with _environment({**SINGLE, PARENT: str(os.getpid())}), deaf_to_interrupts():
        forkserver.ensure_running()


def await_fork_server() -> None:
    """Return when its imports are done. Unlike the start of a worker, which is deaf to it, Ctrl-C ends this wait."""
    nothing = multiprocessing.get_context("forkserver").Process(target=int)
    nothing.start()
    nothing.join()


def one_thread() -> contextlib.AbstractContextManager[None]:
    """One thread for each numerical library of a process started inside: set before it imports them.

    Workers inherit the environment of the process that they are forked from: as it was when that began.
    """
    return _environment(SINGLE)


@contextlib.contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextlib.contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Ctrl-C reaches the whole process group: children started inside never hear it, the parent does on leaving."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # held back; ignored, it would be lost
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
