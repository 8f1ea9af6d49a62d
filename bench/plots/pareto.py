"""Speed against collisions: what a method pays for safety."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from bench.plots import style
from bench.shown import Runs

STAGES: Final = (("T", "training (T)"), ("A", "application (A)"))
LINEAR_BELOW: Final = 0.03
"""Collision rates below this are drawn on a linear scale that holds the zero [%]."""
TICKS: Final = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)


def draw(scenario: str, found: Sequence[Runs]) -> Figure | None:
    """A point for each method with 95 % intervals over seeds; a zero has its bound; None without runs."""
    if not found:
        return None
    figure, axes = style.figure(1, 2, 4.6, sharex=True, sharey=True)
    for (stage, title), panel in zip(STAGES, axes[0], strict=True):
        for runs in found:
            _point(panel, runs, stage)
        panel.set_xscale("symlog", linthresh=LINEAR_BELOW, linscale=0.5)
        panel.set_xlim(-0.006, 130.0)
        panel.xaxis.set_major_locator(FixedLocator(TICKS))
        panel.xaxis.set_minor_locator(NullLocator())
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        style.tidy(panel, "collisions [% of episodes]", "mean speed [m/s]" if stage == "T" else "")
        panel.set_title(f"Scenario {scenario}, {title}", loc="left")
    axes[0, 0].annotate(
        "better", xy=(0.03, 0.985), xytext=(0.16, 0.985), xycoords="axes fraction", textcoords="axes fraction",
        va="top", color=style.GREY, arrowprops={"arrowstyle": "->", "color": style.GREY},
    )  # fmt: skip
    style.legend(figure, [runs.method for runs in found], lines=False)
    return figure


def _point(axes: Axes, runs: Runs, stage: str) -> None:
    rate = runs.collision_rate(stage)
    if not rate.trials:
        return
    speed, spread = runs.mean(stage, lambda c: c.speed_mps)
    look, percent = style.look(runs.method), 100.0 * rate.value
    left, right = (100.0 * abs(end - rate.value) for end in (rate.interval.low, rate.interval.high))
    vertical = None if spread.empty else [[speed - spread.low], [spread.high - speed]]
    axes.errorbar(
        percent, speed, xerr=[[left], [right]], yerr=vertical, color=look.colour, marker=look.marker, linestyle="",
        elinewidth=0.8, markeredgewidth=0.8, clip_on=False, zorder=3,
    )  # fmt: skip
