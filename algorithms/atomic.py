"""Files that are either whole or absent: temporary file in the same folder, fsync, rename."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

TEMPORARY: Final = ".partial-"
"""Prefix of unfinished files and folders; a reader skips them, the next owner removes them."""


def _temporary(path: Path) -> Path:
    return path.with_name(f"{TEMPORARY}{os.getpid()}-{path.name}")


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_file(path: Path, content: bytes) -> None:
    """Write a file so that no reader ever sees a part of it.

    Raises:
        OSError: The disk refuses; the file is then as it was before.
    """
    temporary = _temporary(path)
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def write_folder(path: Path, fill: Callable[[Path], None]) -> None:
    """Fill a new folder and let it appear under its name only when whole.

    Args:
        path: The folder; it must not exist yet.
        fill: Called with an existing, empty folder to write into.

    Raises:
        OSError: The disk refuses, or the folder exists; no such folder appears then.
    """
    temporary = _temporary(path)
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
        fill(temporary)
        for file in files_below(temporary):
            with file.open("rb") as opened:
                os.fsync(opened.fileno())
        _sync_folder(temporary)
        os.rename(temporary, path)
        _sync_folder(path.parent)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def files_below(folder: Path) -> Iterator[Path]:
    """All regular files below a folder, in order of name, without unfinished ones."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not any(part.startswith(TEMPORARY) for part in path.relative_to(folder).parts):
            yield path
