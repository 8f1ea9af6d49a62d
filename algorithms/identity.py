"""Which code a result comes from: sources and packages as one digest."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
import platform
from pathlib import Path
from typing import Any, Final

PROJECT: Final = Path(__file__).resolve().parent.parent
LEARNING: Final = ("envs", "algorithms")
"""Folders whose files decide how a training goes on."""
PACKAGES: Final = (
    "safedrive-bench", "numpy", "torch", "numba", "llvmlite", "gymnasium", "highway-env", "stable-baselines3",
    "safetensors", "pandas", "pyarrow", "pydantic", "scipy", "omnisafe",
)  # fmt: skip
"""Packages that results, or the bytes of their records, may depend on."""


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
    """Installed versions of `PACKAGES`; absent ones are left out."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def learning_identity(*parts: Any) -> str:
    """What a training must have in common with the checkpoint that it goes on from; 64 hexadecimal digits.

    Sources of environment and methods, packages, Python, and the given JSON values.
    """
    content = [source_digest(LEARNING), package_versions(), platform.python_version(), *parts]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
