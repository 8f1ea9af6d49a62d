"""Learning curves: return, collisions and interventions in training against steps and against wall time."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench import learning_curve
from bench.learning_curve import LearningCurve
from bench.plots import style
from bench.plots.data import Array
from bench.shown import Runs

WINDOWS: Final = 25
"""Points of a curve."""
PANELS: Final = (
    ("returns", "return without $r_\\mathrm{risk}$", 1.0),
    ("collision_rates", "collisions [%]", 100.0),
    ("intervention_ratios", "interventions [%]", 100.0),
)
LAST: Final = len(PANELS) - 1


def draw(scenario: str, found: Sequence[Runs]) -> Figure | None:
    """Mean of the seeds with a band from the lowest to the highest, for each method that trains; None without any."""
    shown = [runs for runs in found if runs.method in style.CORE and runs.records[0].spec.steps]
    if not shown:
        return None
    figure, axes = style.figure(len(PANELS), 2, 6.2, sharex="col", sharey="row")
    for runs in shown:
        curves = [learning_curve.of(record, max(1, record.spec.steps // WINDOWS)) for record in runs.records]
        for row, (name, _, scale) in enumerate(PANELS):
            values = scale * np.array([getattr(curve, name) for curve in curves])
            if row == LAST and not np.nansum(values):
                continue  # no guard, so nothing to intervene
            _band(axes[row, 0], runs.method, curves[0].stop / 1_000.0, values)
            _band(axes[row, 1], runs.method, _minutes(curves), values)
    for row, (_, label, _) in enumerate(PANELS):
        style.tidy(axes[row, 0], "simulation steps [1,000]" if row == LAST else "", label)
        style.tidy(axes[row, 1], "wall time [min]" if row == LAST else "")
        for column in (0, 1):
            axes[row, column].set_xlim(left=0.0)
    axes[1, 0].set_ylim(bottom=-2.0)
    axes[LAST, 0].set_ylim(bottom=0.0)
    axes[0, 0].set_title(f"Scenario {scenario}, training: {_seeds(shown)}", loc="left")
    style.legend(figure, [runs.method for runs in shown])
    return figure


def _seeds(shown: Sequence[Runs]) -> str:
    """What lines and bands are."""
    most = max(len(runs.records) for runs in shown)
    return "one seed" if most == 1 else f"mean and range of up to {most} seeds"


def _band(axes: Axes, method: str, x: Array, values: Array) -> None:
    """Values of shape (seeds, windows)."""
    look = style.look(method)
    with warnings.catch_warnings():
        # A window in which no seed finished an episode is a gap.
        warnings.simplefilter("ignore", RuntimeWarning)
        mean, low, high = np.nanmean(values, axis=0), np.nanmin(values, axis=0), np.nanmax(values, axis=0)
    axes.plot(x, mean, color=look.colour, linestyle=look.line)
    axes.fill_between(x, low, high, color=look.colour, alpha=0.18, linewidth=0.0)


def _minutes(curves: Sequence[LearningCurve]) -> Array:
    """Mean over seeds of the time at which each window ended."""
    minutes: Array = np.mean([curve.wall_s for curve in curves], axis=0) / 60.0
    return minutes
