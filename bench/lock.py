"""One owner per run folder: an advisory lock that names who holds it and since when."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import psutil

from bench.errors import LockedError

LOCK_NAME: Final = "LOCK"
SILENT_S: Final = 600.0
"""An owner on another host that gave no sign for so long is taken for dead [s]."""
TOUCH_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class Owner:
    """Who holds a lock, as its file says."""

    pid: int
    host: str
    started: float

    @classmethod
    def read(cls, path: Path) -> Owner | None:
        """The owner named in a lock file, or None where there is none to read."""
        try:
            content: dict[str, Any] = json.loads(path.read_text())
            return cls(int(content["pid"]), str(content["host"]), float(content["started"]))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def describe(self) -> str:
        """For people, with the age."""
        age = max(0.0, time.time() - self.started)
        return f"process {self.pid} on {self.host}, since {age / 60.0:.0f} min"

    def alive(self, path: Path) -> bool:
        """Whether the owner may still be at work, judged without the kernel's lock."""
        if self.host != socket.gethostname():
            with contextlib.suppress(OSError):
                return time.time() - path.stat().st_mtime < SILENT_S
            return False
        try:
            # A process that is younger than the lock has only inherited the number.
            return bool(psutil.Process(self.pid).create_time() <= self.started + 1.0)
        except psutil.NoSuchProcess:
            return False


class RunLock:
    """Context manager that holds the lock of a run folder.

    The kernel's lock (flock) decides on one host: it dies with its process, so a killed owner leaves no lock
    behind. Where the file names another host, which flock may not reach, its last sign of life decides.

    Raises:
        LockedError: On entry, where another process holds it; the message names the owner.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / LOCK_NAME
        self._descriptor = -1
        self._touched = 0.0

    def __enter__(self) -> Self:
        """Take the lock, also from a dead owner."""
        while True:
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                self._claim(descriptor)
            except BaseException:
                os.close(descriptor)
                raise
            if self._is_current(descriptor):
                self._descriptor = descriptor
                self._write_owner()
                return self
            os.close(descriptor)  # its last owner removed the file meanwhile: take the new one

    def _claim(self, descriptor: int) -> None:
        owner = Owner.read(self.path)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = owner or Owner.read(self.path)
            who = owner.describe() if owner else "another process"
            raise LockedError(f"{self.path.parent.name} is being run by {who}.") from None
        if owner is not None and owner.host != socket.gethostname() and owner.alive(self.path):
            raise LockedError(
                f"{self.path.parent.name} is being run by {owner.describe()}; "
                f"if that machine has stopped, remove {self.path.parent.name}/{LOCK_NAME}."
            )

    def _is_current(self, descriptor: int) -> bool:
        with contextlib.suppress(OSError):
            return os.fstat(descriptor).st_ino == self.path.stat().st_ino
        return False

    def _write_owner(self) -> None:
        owner = {"pid": os.getpid(), "host": socket.gethostname(), "started": time.time()}
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, json.dumps(owner).encode(), 0)

    def touch(self) -> None:
        """Sign of life for other hosts, at most every 10 s."""
        if time.monotonic() - self._touched > TOUCH_S:
            self._touched = time.monotonic()
            with contextlib.suppress(OSError):
                os.utime(self.path)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the lock back and remove its file."""
        with contextlib.suppress(OSError):
            self.path.unlink()
        os.close(self._descriptor)


def current_owner(folder: Path) -> Owner | None:
    """Who is at work in a run folder now, or None."""
    path = folder / LOCK_NAME
    owner = Owner.read(path)
    return owner if owner is not None and owner.alive(path) else None
