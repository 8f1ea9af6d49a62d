"""OmniSafe, imported beside a newer gymnasium, and kept from changing the state of the process."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import importlib.util
import io
import os
import random
import sys
import types
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from algorithms.registry import UnavailableMethodError

VERSION: Final = "0.5.0"
"""The release whose sources the adapter was written against."""

_UNUSED_MODULES: Final = (
    "safety_gymnasium",  # pins gymnasium <= 0.28.1; its environments are not ours
    "wandb",  # logger we switch off
    "gdown",  # downloads data sets of offline methods
    "gymnasium.utils.save_video",  # needs moviepy; videos of model-based methods
    "torch.utils.tensorboard.writer",  # needs tensorboard; logger we switch off
    "matplotlib",  # figures of model-based methods and of its own plotter, as the next three
    "matplotlib.pyplot",
    "pandas",
    "seaborn",
)
"""Imported by OmniSafe at its start, used by nothing that we call; some cannot be, and together they take 1.5 s."""

_ENVIRONMENT_KEYS: Final = ("PYTHONHASHSEED", "CUBLAS_WORKSPACE_CONFIG", "OMNISAFE_DEVICE")
"""Environment variables that OmniSafe writes."""

REMEDY: Final = f"Install it with: pip install --no-deps omnisafe=={VERSION} pyyaml tqdm"


def stand_in(name: str) -> types.ModuleType:
    """A module whose functions and classes exist, but raise when they are called."""

    def attribute(attribute_name: str) -> Callable[..., Any]:
        if attribute_name.startswith("__"):
            raise AttributeError(f"module {name!r} has no attribute {attribute_name!r}")

        def unusable(*_arguments: Any, **_keywords: Any) -> Any:
            raise UnavailableMethodError(f"{name}.{attribute_name} is a stand-in: OmniSafe is imported without {name}.")

        return unusable

    module = types.ModuleType(name, "Stands in for a module that OmniSafe imports and we do not use.")
    module.__getattr__ = attribute  # type: ignore[method-assign]
    return module


@contextlib.contextmanager
def _unused_modules_present() -> Iterator[None]:
    """Stand-ins in `sys.modules` for the unused modules that are not there yet, taken out again afterwards."""
    absent = [name for name in _UNUSED_MODULES if name not in sys.modules]
    for name in absent:
        sys.modules[name] = stand_in(name)
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]


def omnisafe_module(name: str = "omnisafe") -> Any:
    """A module of OmniSafe.

    Raises:
        UnavailableMethodError: OmniSafe, or a package that it needs, cannot be imported.
    """
    if name in sys.modules:
        return sys.modules[name]
    try:
        with _unused_modules_present():
            return importlib.import_module(name)
    except Exception as error:  # it may raise anything on a stack that it does not know
        raise UnavailableMethodError(
            f"OmniSafe cannot be imported: {type(error).__name__}: {error}. {REMEDY}"
        ) from error


def require_omnisafe() -> None:
    """Raise `UnavailableMethodError` where OmniSafe is not installed; does not import it, which takes seconds."""
    for name in ("omnisafe", "yaml", "tqdm"):
        if importlib.util.find_spec(name) is None:
            raise UnavailableMethodError(f"The package {name!r}, which this method needs, is not installed. {REMEDY}")


def algorithm_defaults(algorithm: str) -> dict[str, Any]:
    """Sections of OmniSafe's own configuration of an on-policy algorithm."""
    config = omnisafe_module("omnisafe.utils.config")
    with contextlib.redirect_stdout(io.StringIO()):
        sections: dict[str, Any] = config.get_default_kwargs_yaml(algorithm, "", "on-policy").todict()
    return sections


@contextlib.contextmanager
def process_state_kept() -> Iterator[None]:
    """Silence OmniSafe, give torch one thread, and put back every global that its training changes.

    It seeds the generators of random, numpy and torch, asks torch for deterministic algorithms, switches cuDNN
    off, sets environment variables, prints, and leaves exit handlers behind.
    """
    import torch  # not by whoever only asks whether OmniSafe is there

    generators = random.getstate(), np.random.get_state(), torch.get_rng_state()  # noqa: NPY002
    deterministic = torch.get_deterministic_debug_mode()
    cudnn = torch.backends.cudnn.enabled, torch.backends.cudnn.benchmark, torch.backends.cudnn.deterministic
    threads = torch.get_num_threads()
    variables = {key: os.environ.get(key) for key in _ENVIRONMENT_KEYS}
    torch.set_num_threads(1)
    try:
        with open(os.devnull, "w", encoding="utf-8") as nowhere, contextlib.redirect_stdout(nowhere):
            yield
    finally:
        random.setstate(generators[0])
        np.random.set_state(generators[1])  # noqa: NPY002
        torch.set_rng_state(generators[2])
        torch.set_deterministic_debug_mode(deterministic)
        torch.backends.cudnn.enabled, torch.backends.cudnn.benchmark, torch.backends.cudnn.deterministic = cudnn
        torch.set_num_threads(threads)
        for key, value in variables.items():
            os.environ.pop(key, None)
            if value is not None:
                os.environ[key] = value


def close_logger(logger: Any) -> None:
    """Close the logger's file and forget the exit handler that would keep it alive."""
    logger.close()
    atexit.unregister(logger._output_file.close)
