"""``bench doctor``: what runs need on this machine, and how to mend what is missing."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bench.provenance import usable_cores
from bench.text import columns

PYTHON_MIN: Final = (3, 11)
DISK_MIN_GIB: Final = 2.0
REQUIRED: Final = (
    "numpy", "numba", "gymnasium", "torch", "stable-baselines3", "pyarrow", "pandas", "pydantic", "scipy",
    "safetensors", "typer", "rich", "psutil",
)  # fmt: skip
OPTIONAL: Final = {
    "highway-env": "needed to render and to compare with the oracle: pip install highway-env",
    "matplotlib": "needed for plots: pip install matplotlib",
    "ray": "only for clusters: pip install '.[ray]'",
}


@dataclass(frozen=True, slots=True)
class Check:
    """One finding.

    Attributes:
        name: What was looked at.
        ok: Whether it is as it should be.
        required: Whether runs need it.
        found: What was found.
        remedy: What to do where it is not ok.
    """

    name: str
    ok: bool
    required: bool
    found: str
    remedy: str = ""


def examine(results: Path) -> list[Check]:
    """All checks; none of them raises."""
    probes: Sequence[Callable[[], list[Check]]] = (
        _python, _packages, _threads, _kernels, _ffmpeg, _omnisafe, _methods, lambda: _disk(results)
    )  # fmt: skip
    found: list[Check] = []
    for probe in probes:
        try:
            found += probe()
        except Exception as error:  # a broken installation may raise anything: that is a finding
            name = getattr(probe, "__name__", "check").strip("_<>")
            found.append(Check(name, False, True, f"{type(error).__name__}: {error}", "install the project again"))
    return found


def _python() -> list[Check]:
    version = ".".join(map(str, sys.version_info[:3]))
    ok = sys.version_info >= PYTHON_MIN
    return [Check("python", ok, True, version, "" if ok else "Python 3.11 or newer: make venv PYTHON=...")]


def _packages() -> list[Check]:
    checks = []
    for name in (*REQUIRED, *OPTIONAL):
        required = name in REQUIRED
        try:
            checks.append(Check(name, True, required, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:
            remedy = "pip install ." if required else OPTIONAL[name]
            checks.append(Check(name, False, required, "not installed", remedy))
    return checks


def _threads() -> list[Check]:
    cores = usable_cores()
    threads = os.environ.get("OMP_NUM_THREADS")
    return [
        Check("cores", cores >= 1, True, f"{cores} usable"),
        Check(
            "threads",
            threads in (None, "1"),
            False,
            f"OMP_NUM_THREADS={threads or 'unset'} (workers of bench run always get 1)",
            "export OMP_NUM_THREADS=1: several threads on one core slow a learner down up to a hundred times",
        ),
    ]


def _kernels() -> list[Check]:
    """The engine steps, and its compiled code can be kept."""
    import numpy as np

    from envs.driving_env import DrivingVectorEnv

    env = DrivingVectorEnv("b", 2)
    env.reset(seed=0)
    env.step(np.zeros((2, 2)))
    import numba

    folder = str(os.environ.get("NUMBA_CACHE_DIR") or numba.config.CACHE_DIR)  # type: ignore[attr-defined]
    ok = _writable(Path(folder))
    remedy = "" if ok else "set XDG_CACHE_HOME to a folder that can be written, or every process compiles anew"
    return [
        Check("engine", True, True, "steps scenario b"),
        Check("kernel cache", ok, False, "writable" if ok else "not writable", remedy),
    ]


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _ffmpeg() -> list[Check]:
    remedy = "needed for MP4 only: pip install imageio-ffmpeg"
    try:
        import imageio_ffmpeg

        return [Check("ffmpeg", True, False, str(imageio_ffmpeg.get_ffmpeg_version()))]
    except (ImportError, RuntimeError) as error:
        return [Check("ffmpeg", False, False, str(error), remedy)]


def _omnisafe() -> list[Check]:
    """Whether it is there, of the release that our adapter knows, and survives being imported."""
    from algorithms.omnisafe_library import REMEDY, VERSION, omnisafe_module, require_omnisafe
    from algorithms.registry import UnavailableMethodError

    try:
        require_omnisafe()
        version = str(omnisafe_module().__version__)
    except UnavailableMethodError as error:
        return [Check("omnisafe", False, False, str(error).removesuffix(REMEDY).strip(), REMEDY)]
    known = version == VERSION
    found = f"{version}, can be imported" if known else f"{version}, but the adapter is written for {VERSION}"
    return [Check("omnisafe", known, False, found, "" if known else REMEDY)]


def _methods() -> list[Check]:
    from algorithms.registry import list_methods

    checks = []
    for listing in list_methods():
        found = f"from {listing.origin}" if listing.available else listing.reason
        remedy = "" if listing.available else "optional; the reason says what helps"
        checks.append(Check(f"method {listing.name}", listing.available, listing.name == "sac", found, remedy))
    return checks


def _disk(results: Path) -> list[Check]:
    folder = results.absolute()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free / 2**30
    writable = os.access(folder, os.W_OK)
    return [
        Check(
            "disk",
            free >= DISK_MIN_GIB and writable,
            True,
            f"{free:.1f} GiB free for {results}" + ("" if writable else ", not writable"),
            "" if free >= DISK_MIN_GIB and writable else "free some room, or choose another folder with --results",
        )
    ]


def healthy(checks: Sequence[Check]) -> bool:
    """Whether everything that runs need is there."""
    return all(check.ok or not check.required for check in checks)


def as_values(checks: Sequence[Check]) -> dict[str, Any]:
    """``{"healthy": ..., "checks": [...]}``."""
    return {"healthy": healthy(checks), "checks": [dataclasses.asdict(check) for check in checks]}


def as_text(checks: Sequence[Check]) -> str:
    """A table."""
    rows = [
        (
            "ok" if check.ok else "BROKEN" if check.required else "absent",
            check.name,
            check.found + (f"; {check.remedy}" if check.remedy and not check.ok else ""),
        )
        for check in checks
    ]
    verdict = "Everything that runs need is there." if healthy(checks) else "Runs will fail here: see BROKEN."
    return f"{columns(('', 'what', 'found'), rows)}\n{verdict}"
