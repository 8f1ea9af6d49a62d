"""``bench plot``: every figure that the records allow."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from bench.plots import distributions, interventions, learning, pareto, spacetime, style, sweep
from bench.plots.data import runs
from bench.records import Collection
from bench.replay.held_out import ReplayDiffersError
from bench.shown import SCENARIOS, Runs


def write(collection: Collection, folder: Path, say: Callable[[str], None] = lambda _: None) -> list[Path]:
    """Draw each figure as PDF and PNG; the same records give the same bytes. What has no runs is not drawn.

    Args:
        collection: The records.
        folder: Where to.
        say: Told why a figure could not be drawn: its episode comes out otherwise on this machine.

    Returns:
        The files.

    Raises:
        RecordError: A record cannot be used.
    """
    paths = []
    found = {scenario: runs(collection, scenario) for scenario in SCENARIOS}
    with style.styled():
        for name, draw in _figures(found).items():
            try:
                drawn = draw()
            except ReplayDiffersError as error:
                say(f"{name} is not drawn: {error}")
                continue
            if drawn is not None:
                paths += style.save(drawn, folder, name)
    return paths


def _figures(found: dict[str, list[Runs]]) -> dict[str, Callable[[], Figure | None]]:
    figures: dict[str, Callable[[], Figure | None]] = {}
    for scenario, entries in found.items():
        for name, module in (
            ("learning", learning), ("pareto", pareto), ("tc-sweep", sweep), ("space-time", spacetime)
        ):  # fmt: skip
            figures[f"{name}-{scenario}"] = functools.partial(module.draw, scenario, entries)
    return {
        **figures,
        "interventions": functools.partial(interventions.draw, found),
        "profiles": functools.partial(distributions.profiles, found),
        "least-ttc": functools.partial(distributions.least_ttc, found),
    }
