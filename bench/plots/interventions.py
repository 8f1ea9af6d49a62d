"""How often each guard intervenes, in training and application, beside what the paper prints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bench.plots import style
from bench.published import read_figures
from bench.shown import Runs


def draw(found: dict[str, list[Runs]]) -> Figure | None:
    """A row for each guarded learner, a panel for each scenario; None where no guard ever intervened."""
    guarded = {scenario: [runs for runs in entries if _intervenes(runs)] for scenario, entries in found.items()}
    panels = {scenario: entries for scenario, entries in guarded.items() if entries}
    if not panels:
        return None
    rows = [len(entries) for entries in panels.values()]
    figure, axes = style.figure(
        len(panels), 1, 1.0 + 0.22 * sum(rows), sharex=True, gridspec_kw={"height_ratios": rows}
    )
    for panel, (scenario, entries) in zip(axes[:, 0], panels.items(), strict=True):
        _panel(panel, scenario, entries)
    axes[-1, 0].set_xlabel("steps in which the guard intervened [%]")
    figure.legend(handles=_handles(), loc="outside lower center", ncols=3)
    return figure


def _intervenes(runs: Runs) -> bool:
    """Scripted drivers are left out: they do not learn to avoid the guard, and would set the scale."""
    return runs.records[0].spec.steps > 0 and any(
        c.intervention_ratio > 0.0 for stage in "TA" for c in runs.counts(stage)
    )


def _panel(axes: Axes, scenario: str, entries: Sequence[Runs]) -> None:
    paper = _published(scenario)
    for row, runs in enumerate(entries):
        for stage, offset in (("T", -0.16), ("A", 0.16)):
            value, interval = runs.mean(stage, lambda c: c.intervention_ratio, 100.0)
            if not np.isfinite(value):
                continue
            error = None if interval.empty else [[value - max(0.0, interval.low)], [interval.high - value]]
            look = _stage_look(style.look(runs.method).colour, stage)
            axes.errorbar(value, row + offset, xerr=error, elinewidth=0.8, **look)
            if (runs.method, stage) in paper:
                axes.plot(paper[runs.method, stage], row + offset, **_PAPER)
    axes.set_yticks(range(len(entries)), [style.look(runs.method).label for runs in entries])
    axes.set_ylim(len(entries) - 0.5, -0.5)
    axes.set_xlim(left=0.0)
    style.tidy(axes)
    axes.set_title(f"Scenario {scenario}", loc="left")


_PAPER: dict[str, Any] = {"color": style.PAPER_COLOUR, "marker": "|", "markersize": 8, "linestyle": "", "zorder": 4}


def _stage_look(colour: str, stage: str) -> dict[str, Any]:
    face = colour if stage == "T" else "white"
    return {"color": colour, "marker": "o", "markerfacecolor": face, "linestyle": "", "zorder": 3}


def _published(scenario: str) -> dict[tuple[str, str], float]:
    return {
        (f.method, f.stage): float(f.value)
        for f in read_figures()
        if f.metric == "intervention_ratio" and f.scenario == scenario and f.value
    }


def _handles() -> list[Line2D]:
    return [
        Line2D([], [], label="training (T)", **_stage_look(style.GREY, "T")),
        Line2D([], [], label="application (A)", **_stage_look(style.GREY, "A")),
        Line2D([], [], label="the paper's", **_PAPER),
    ]
