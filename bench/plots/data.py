"""What figures draw: the runs that are shown, in the order of legends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy.typing as npt

from bench import shown
from bench.plots.style import order
from bench.records import Collection
from bench.shown import Runs

Array = npt.NDArray[Any]


def runs(collection: Collection, scenario: str) -> list[Runs]:
    """Those that are shown, in the order of legends."""
    return sorted(shown.runs(collection, scenario), key=lambda entry: order(entry.method))


def pick(found: Sequence[Runs], methods: Sequence[str]) -> list[Runs]:
    """Those of the given methods that there are."""
    return [entry for entry in found if entry.method in methods]
