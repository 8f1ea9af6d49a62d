"""``bench plot``: every figure that the records allow."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from bench.plots import distributions, interventions, learning, pareto, spacetime, style, sweep
from bench.plots.data import SCENARIOS, runs
from bench.records import Collection


def write(collection: Collection, folder: Path) -> list[Path]:
    """Draw each figure as PDF and PNG; the same records give the same bytes. What has no runs is not drawn.

    Args:
        collection: The records.
        folder: Where to.

    Returns:
        The files.

    Raises:
        RecordError: A record cannot be used.
    """
    paths = []
    with style.styled():
        for name, drawn in _figures(collection):
            if drawn is not None:
                paths += style.save(drawn, folder, name)
    return paths


def _figures(collection: Collection) -> Iterator[tuple[str, Figure | None]]:
    found = {scenario: runs(collection, scenario) for scenario in SCENARIOS}
    for scenario, entries in found.items():
        yield f"learning-{scenario}", learning.draw(scenario, entries)
        yield f"pareto-{scenario}", pareto.draw(scenario, entries)
        yield f"tc-sweep-{scenario}", sweep.draw(scenario, entries)
        yield f"space-time-{scenario}", spacetime.draw(scenario, entries)
    yield "interventions", interventions.draw(found)
    yield "profiles", distributions.profiles(found)
    yield "least-ttc", distributions.least_ttc(found)
