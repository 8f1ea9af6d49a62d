"""Artefacts that runs share (driving agents, risk models): built once, keyed by hash, whole or not there."""

from __future__ import annotations

import fcntl
import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from algorithms import atomic

Making = Callable[[str, int, int], None]
"""Called with what is being made, how much of it is done, and of how much in all."""


WAIT_S: Final = 1.0


@contextmanager
def _exclusive(path: Path, waiting: Callable[[], None]) -> Iterator[None]:
    """Hold a lock file: whoever asks for the same artefact meanwhile waits, and gives signs of life."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as handle:
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                waiting()
                time.sleep(WAIT_S)
        yield


def cached(folder: Path, build: Callable[[Path], None], waiting: Callable[[], None] = lambda: None) -> Path:
    """The folder, built at most once however many processes ask: complete, or not there.

    Args:
        folder: Final place; its parent is made.
        build: Writes the content into the empty folder it is given.
        waiting: Called every second while another process builds it.
    """
    with _exclusive(folder.with_suffix(".lock"), waiting):
        if not folder.exists():
            for leftover in folder.parent.glob(f"{atomic.TEMPORARY}*-{folder.name}"):
                shutil.rmtree(leftover, ignore_errors=True)
            atomic.write_folder(folder, build)
    return folder


def digest(description: Mapping[str, Any]) -> str:
    """Short hash of a JSON-like description."""
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()[:12]
