"""Entry points of installed packages: names that others add, loaded when asked for; a broken one hides no other."""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Mapping
from typing import Any


class UnavailableError(RuntimeError):
    """A known name cannot be used here; the message says why and what helps."""


class DuplicateNameError(UnavailableError):
    """Several origins claim one name."""

    def __init__(self, kind: str, name: str, origins: list[str]) -> None:
        claims = " and by ".join(origins)
        super().__init__(f"{kind} name {name!r} is claimed by {claims}: rename or uninstall all but one.")


def origins(group: str, built_in: Mapping[str, str]) -> dict[str, list[str]]:
    """Every known name with all that claim it, ``module:attribute`` each.

    Args:
        group: Entry-point group.
        built_in: Origins by name that need no entry point.
    """
    known = {name: [origin] for name, origin in built_in.items()}
    for point in importlib.metadata.entry_points(group=group):
        claims = known.setdefault(point.name, [])
        if point.value not in claims:
            claims.append(point.value)
    return known


def load(origin: str) -> Any:
    """The object of an origin ``module:attribute``.

    Raises:
        UnavailableError: It cannot be imported; a plugin may raise anything, SystemExit included.
    """
    module, _, attribute = origin.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except UnavailableError:
        raise
    except (Exception, SystemExit) as error:
        raise UnavailableError(f"{origin} failed to load: {type(error).__name__}: {error}") from error
