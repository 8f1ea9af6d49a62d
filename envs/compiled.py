"""Numba's compiler with the settings that every kernel of this project shares."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import numba.core.config
import numpy.typing as npt
from numba.core import cgutils
from numba.extending import intrinsic

from envs.world import JIT_DISABLED

A = TypeVar("A", bound=npt.NDArray[Any])
F = TypeVar("F", bound=Callable[..., Any])

_PROJECT = Path(__file__).resolve().parent.parent


def _source_digest() -> str:
    """Hash of every source file that a kernel may be compiled from: envs, and what defines kernels elsewhere."""
    digest = hashlib.sha256()
    for path in sorted([*(_PROJECT / "envs").glob("*.py"), *(_PROJECT / "algorithms").glob("*.py")]):
        source = path.read_bytes()
        if path.parent.name == "envs" or b"njit" in source:
            digest.update(source)
    return digest.hexdigest()[:16]


def _cache_directory() -> Path:
    """A writable folder for compiled code, one for each state of the sources.

    Numba looks only at the file of the outermost function to decide whether cached code is stale: after a
    change of motion.py it would go on running the old physics inside engine.py. Hence a folder per digest.
    """
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    for root in (Path(home), Path(tempfile.gettempdir())):
        directory = root / "safedrive-bench" / f"numba-{_source_digest()}"
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK):
            return directory
    raise OSError("No writable folder for compiled code; set XDG_CACHE_HOME to one.")


_settings: Any = numba.core.config
_settings.DISABLE_JIT = int(JIT_DISABLED)  # the records of `envs.world` are made for one of the two

if not os.environ.get("NUMBA_CACHE_DIR"):
    _settings.CACHE_DIR = str(_cache_directory())
# OpenMP's threads stay awake, and the calling one works, too: two threads are 1.8 times one. Those of the workqueue
# are woken on one core, and two were 1.1 times one. Where there is no libgomp, the workqueue has to do.
_settings.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]


def njit(function: F) -> F:
    """Compile a kernel: cached on disk, numpy's division rules, no fast-math (results are repeatable)."""
    compiled: Any = numba.njit(cache=True, error_model="numpy")(function)
    return cast(F, compiled)


def njit_inlined(function: F) -> F:
    """The same, always compiled into its caller: handing over records and arrays costs 0.1 us a call."""
    compiled: Any = numba.njit(cache=True, error_model="numpy", forceinline=True)(function)
    return cast(F, compiled)


def njit_parallel(function: F) -> F:
    """The same with `prange` over worlds on numba's threads."""
    compiled: Any = numba.njit(cache=True, error_model="numpy", parallel=True)(function)
    return cast(F, compiled)


def _without_owner(_: Any, array: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        view = context.make_array(signature.args[0])(context, builder, values[0])
        null: Any = cgutils.get_null_value
        view.meminfo, view.parent = null(view.meminfo.type), null(view.parent.type)
        return view._getvalue()

    return array(array), generate


def _unchanged(array: A) -> A:
    return array


borrowed: Final = cast(Callable[[A], A], _unchanged if JIT_DISABLED else intrinsic(_without_owner))
"""Inside a kernel: an argument of it without its reference count; the caller holds the array until the kernel ends.

Numba counts references to arrays by atomic additions at every call of a function. In an engine of many small
functions that was 0.4 of a step. Never for an array made inside the kernel: it would be freed under the reader's hands.
"""
