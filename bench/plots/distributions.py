"""Performance profiles of the return, and how close the ego came: the least time to collision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.plots import style
from bench.plots.data import Array, pick
from bench.shown import Runs, returns
from bench.statistics import performance_profile
from bench.summary import count_record

SHOWN: Final = (*style.CORE, "cruise", "random")
POINTS: Final = 200
TTC_MAX_S: Final = 10.0
LOW_TTC_S: Final = 1.5
"""As in `low_ttc` of the leaderboard."""


def profiles(found: dict[str, list[Runs]]) -> Figure | None:
    """Share of held-out episodes with a return above each value; None without runs."""
    drawn = _panels(found, lambda axes, entries: _profile(axes, entries), "share of episodes above it")
    if drawn is None:
        return None
    figure, axes = drawn
    for panel in axes:
        panel.set_xlabel("return without $r_\\mathrm{risk}$ of a held-out episode")
    return figure


def _profile(axes: Axes, entries: Sequence[Runs]) -> None:
    values = [np.array([returns(record) for record in runs.records]) for runs in entries]
    low = min(float(np.quantile(v, 0.01)) for v in values)
    high = max(float(v.max()) for v in values)
    thresholds = np.linspace(min(low, 0.0), high, POINTS)
    for runs, scores in zip(entries, values, strict=True):
        _line(axes, runs, thresholds, [performance_profile(row[None, :], thresholds) for row in scores])


def least_ttc(found: dict[str, list[Runs]]) -> Figure | None:
    """Share of held-out episodes whose least time to collision is below each value; None without runs."""
    drawn = _panels(found, _ttc, "share of episodes below it")
    if drawn is None:
        return None
    figure, axes = drawn
    for panel in axes:
        panel.set_xlabel("least time to collision of a held-out episode [s]")
        panel.axvline(LOW_TTC_S, color=style.GREY, linewidth=0.7, linestyle=":")
        panel.set_xlim(0.0, TTC_MAX_S)
    return figure


def _ttc(axes: Axes, entries: Sequence[Runs]) -> None:
    limits = np.linspace(0.0, TTC_MAX_S, POINTS)
    for runs in entries:
        least = [np.sort(count_record(record, "A").ttc_min_s) for record in runs.records]
        _line(axes, runs, limits, [np.searchsorted(v, limits, side="right") / len(v) for v in least])


def _line(axes: Axes, runs: Runs, x: Array, seeds: Sequence[Array]) -> None:
    """Mean of the seeds with a band from the lowest to the highest."""
    look, values = style.look(runs.method), np.array(seeds)
    axes.plot(x, values.mean(axis=0), color=look.colour, linestyle=look.line)
    axes.fill_between(x, values.min(axis=0), values.max(axis=0), color=look.colour, alpha=0.15, linewidth=0.0)


def _panels(
    found: dict[str, list[Runs]], draw: Callable[[Axes, Sequence[Runs]], None], label: str
) -> tuple[Figure, list[Axes]] | None:
    """A panel for each scenario with runs, and a legend for all."""
    found = {scenario: pick(entries, SHOWN) for scenario, entries in found.items()}
    scenarios = [scenario for scenario, entries in found.items() if entries]
    if not scenarios:
        return None
    figure, axes = style.figure(1, len(scenarios), 3.6, sharey=True)
    for panel, scenario in zip(axes[0], scenarios, strict=True):
        draw(panel, found[scenario])
        style.tidy(panel, "", label if panel is axes[0, 0] else "")
        panel.set_title(f"Scenario {scenario}, application", loc="left")
        panel.set_ylim(0.0, 1.0)
    methods = {runs.method for scenario in scenarios for runs in found[scenario]}
    style.legend(figure, methods)
    return figure, list(axes[0])
