"""Which code a result comes from: sources and packages as one digest."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
import platform
import re
from pathlib import Path
from typing import Any, Final

PROJECT: Final = Path(__file__).resolve().parent.parent
LEARNING: Final = ("envs", "algorithms")
"""Folders whose files decide how a training goes on."""
ROOTS: Final = ("safedrive-bench", "omnisafe")
"""Packages whose requirements, and theirs in turn, results may depend on."""


@functools.cache
def source_digest(folders: tuple[str, ...]) -> str:
    """SHA-256 over the Python files in these folders of the project; works without git."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted((PROJECT / folder).rglob("*.py")):
            digest.update(str(path.relative_to(PROJECT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@functools.cache
def package_versions() -> dict[str, str]:
    """Installed versions of `ROOTS` and of all that they require without an extra: a lock, in order of name."""
    versions: dict[str, str] = {}
    left = list(ROOTS)
    while left:
        name = _normal(left.pop())
        if name in versions:
            continue
        try:
            found = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:  # for another system, or replaced by a stand-in
            continue
        versions[name] = found.version
        left += [text for text in found.requires or () if "extra ==" not in text]
    return dict(sorted(versions.items()))


def _normal(requirement: str) -> str:
    """Name in a requirement, as PyPA's specification of names normalises it."""
    name = re.match(r"[A-Za-z0-9._-]+", requirement)
    return re.sub(r"[-_.]+", "-", name.group() if name else requirement).lower()


def learning_identity(*parts: Any) -> str:
    """What a training must have in common with the checkpoint that it goes on from; 64 hexadecimal digits.

    Sources of environment and methods, packages, Python, and the given JSON values.
    """
    content = [source_digest(LEARNING), package_versions(), platform.python_version(), *parts]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
