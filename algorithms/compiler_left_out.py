"""torch's compiler, left out of training: optimisers import it, 1.3 s and more, only to hide themselves from it."""

from __future__ import annotations

import importlib
import sys
import types
from collections.abc import Callable
from typing import Any, Final

COMPILER: Final = "torch._dynamo"


class _Absent(types.ModuleType):
    """Does what uncompiled code asks of the compiler, nothing; whatever else is asked of it imports the real one."""

    @staticmethod
    def graph_break() -> None:
        """Outside compiled code there is no graph."""

    @staticmethod
    def disable(function: Callable[..., Any], *_arguments: Any, **_keywords: Any) -> Callable[..., Any]:
        """Outside compiled code a function is itself."""
        return function

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name != "__path__":  # what looks through all modules does not mean this one
            raise AttributeError(f"module {COMPILER!r} is left out and has no attribute {name!r}")
        if sys.modules.get(COMPILER) is self:
            del sys.modules[COMPILER]
        return getattr(importlib.import_module(COMPILER), name)


def leave_compiler_out() -> None:
    """Put a stand-in in the compiler's place, unless it is there already; `torch.compile` still works."""
    import torch  # not before it is needed: it takes longer than all the rest of a command

    if COMPILER not in sys.modules:
        absent = _Absent(COMPILER)
        sys.modules[COMPILER] = absent
        torch._dynamo = absent
