"""Where a record comes from: code, packages, machine; nothing that names a host, a user or a path."""

from __future__ import annotations

import functools
import hashlib
import inspect
import os
import platform
import subprocess
from pathlib import Path
from typing import Any, Final

from algorithms import identity
from algorithms.identity import learning_identity, package_versions, source_digest

PROJECT: Final = identity.PROJECT
CODE: Final = (*identity.LEARNING, "bench")
"""Folders whose files decide results."""


def _git(*arguments: str) -> bytes | None:
    """Output of a git command in the project that changes nothing, or None without git or a repository."""
    try:
        return subprocess.run(
            ["git", "--no-optional-locks", *arguments],
            cwd=PROJECT,
            capture_output=True,
            check=True,
            timeout=20,
        ).stdout
    except (OSError, subprocess.SubprocessError):
        return None


def git_state() -> dict[str, Any]:
    """Commit, whether the code differs from it, and a hash of the difference.

    Only the folders that decide results count; new files in them are part of the difference.
    """
    head = _git("rev-parse", "HEAD")
    top = _git("rev-parse", "--show-toplevel")
    if head is None or top is None or Path(top.decode().strip()).resolve() != PROJECT:
        return {"commit": None, "dirty": None, "diff_sha256": None}
    difference = _git("diff", "HEAD", "--no-color", "--no-ext-diff", "--", *CODE) or b""
    new = _git("ls-files", "--others", "--exclude-standard", "-z", "--", *CODE) or b""
    digest = hashlib.sha256(difference)
    for name in sorted(filter(None, new.split(b"\0"))):
        digest.update(name + b"\0" + (PROJECT / os.fsdecode(name)).read_bytes())
    dirty = bool(difference or new)
    return {
        "commit": head.decode().strip(),
        "dirty": dirty,
        "diff_sha256": digest.hexdigest() if dirty else None,
    }


def cpu_model() -> str:
    """Name of the processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@functools.cache
def _code() -> dict[str, Any]:
    """State of the code; read once, near the start of the process, when the modules were imported."""
    return {"git": git_state(), "source_sha256": source_digest(CODE), "packages": package_versions()}


def provenance() -> dict[str, Any]:
    """What ``run.json`` says about code and machine."""
    return {
        **_code(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpu": cpu_model(),
        "threads": {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")},
    }


def run_identity(method: object, spec_hash: str) -> str:
    """What a run must have in common with the checkpoint that it goes on from: also a plugin's own file."""
    own = inspect.getsourcefile(type(method))
    plugin = hashlib.sha256(Path(own).read_bytes()).hexdigest() if own and os.path.exists(own) else ""
    return learning_identity(spec_hash, plugin)


def without_paths(text: str) -> str:
    """A traceback with paths relative to the project or to the installed packages."""
    for folder in (PROJECT, *(Path(entry) for entry in _import_folders()), Path.home(), Path.cwd()):
        if len(folder.parts) > 1:
            text = text.replace(f"{folder}{os.sep}", "")
    return text


def _import_folders() -> list[str]:
    import sys
    import sysconfig

    found = [*sysconfig.get_paths().values(), *sys.path, sys.base_prefix, sys.prefix]
    return sorted({entry for entry in found if os.path.isabs(entry)}, key=len, reverse=True)
