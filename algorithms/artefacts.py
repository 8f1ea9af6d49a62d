"""Artefacts that runs share (driving agents, risk models): built once, keyed by hash, whole or not there."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def _exclusive(path: Path) -> Iterator[None]:
    """Hold a lock file: whoever asks for the same artefact meanwhile waits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def cached(folder: Path, build: Callable[[Path], None]) -> Path:
    """The folder, built at most once however many processes ask: complete, or not there.

    Args:
        folder: Final place; its parent is made.
        build: Writes the content into the empty folder it is given.
    """
    with _exclusive(folder.with_suffix(".lock")):
        if not folder.exists():
            scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
            try:
                build(scratch)
                os.rename(scratch, folder)
            finally:
                shutil.rmtree(scratch, ignore_errors=True)
    return folder


def digest(description: Mapping[str, Any]) -> str:
    """Short hash of a JSON-like description."""
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()[:12]
