"""What a fixed T_c does: collisions, speed and interventions against it, with the risk model's guard as a band."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bench.plots import style
from bench.published import read_figures
from bench.shown import Runs
from bench.statistics import Interval

Value = Callable[[Runs, str], tuple[float, Interval]]
GUARDS: Final = {
    1.0: "safety-guard:tc=1.0", 3.0: "safety-guard", 5.0: "safety-guard:tc=5.0", 7.0: "safety-guard:tc=7.0"
}  # fmt: skip
OURS: Final = "dd-rq"


def _collisions(runs: Runs, stage: str) -> tuple[float, Interval]:
    rate = runs.collision_rate(stage)
    return 100.0 * rate.value, Interval(100.0 * rate.interval.low, 100.0 * rate.interval.high)


PANELS: Final[tuple[tuple[str, str, Value], ...]] = (
    ("collision_rate", "collisions [%]", _collisions),
    ("speed_mps", "mean speed [m/s]", lambda runs, stage: runs.mean(stage, lambda c: c.speed_mps)),
    ("intervention_ratio", "interventions [%]", lambda r, stage: r.mean(stage, lambda c: c.intervention_ratio, 100.0)),
)
STAGES: Final[dict[str, tuple[str, Any, str]]] = {"T": ("training (T)", "-", "o"), "A": ("application (A)", "--", "s")}


def draw(scenario: str, found: Sequence[Runs]) -> Figure | None:
    """Three panels; None with fewer than two values of T_c."""
    guards = {tc: runs for tc, method in GUARDS.items() for runs in found if runs.method == method}
    if len(guards) < 2:
        return None
    ours = next((runs for runs in found if runs.method == OURS), None)
    figure, axes = style.figure(1, 3, 2.8)
    for panel, (metric, label, value) in zip(axes[0], PANELS, strict=True):
        for stage in STAGES:
            _curve(panel, guards, stage, value)
            _paper(panel, scenario, metric, stage)
            if ours is not None:
                _level(panel, ours, stage, value)
        panel.set_xticks(list(GUARDS))
        style.tidy(panel, "$T_c$ [s]", label)
    axes[0, 0].set_ylim(bottom=0.0)
    axes[0, 2].set_ylim(bottom=0.0)
    axes[0, 0].set_title(f"Scenario {scenario}", loc="left")
    figure.legend(handles=_handles(ours is not None), loc="outside lower center", ncols=3)
    return figure


def _curve(axes: Axes, guards: dict[float, Runs], stage: str, value: Value) -> None:
    _, line, marker = STAGES[stage]
    points = [(tc, *value(runs, stage)) for tc, runs in sorted(guards.items())]
    x, y = np.array([(tc, v) for tc, v, _ in points]).T
    low, high = (np.array([0.0 if i.empty else abs(v - end(i)) for _, v, i in points]) for end in (_low, _high))
    x = x + (0.08 if stage == "A" else -0.08)
    axes.errorbar(x, y, yerr=[low, high], color=style.look("safety-guard").colour, linestyle=line, marker=marker,
                  elinewidth=0.8, capsize=1.5)  # fmt: skip


def _low(interval: Interval) -> float:
    return max(0.0, interval.low)


def _high(interval: Interval) -> float:
    return interval.high


def _level(axes: Axes, ours: Runs, stage: str, value: Value) -> None:
    middle, interval = value(ours, stage)
    colour = style.look(OURS).colour
    axes.axhline(middle, color=colour, linestyle=STAGES[stage][1])
    if not interval.empty:
        axes.axhspan(_low(interval), interval.high, color=colour, alpha=0.12, linewidth=0.0)


def _paper(axes: Axes, scenario: str, metric: str, stage: str) -> None:
    tc_of = {method: tc for tc, method in GUARDS.items()}
    figures = [
        (tc_of[f.method], float(f.value))
        for f in read_figures()
        if (f.table, f.scenario, f.metric, f.stage) == ("ablation", scenario, metric, stage) and f.method in tc_of
    ]
    if figures:
        x, y = zip(*figures, strict=True)
        axes.plot(x, y, **_paper_look(stage))


def _paper_look(stage: str) -> dict[str, Any]:
    _, line, marker = STAGES[stage]
    return {
        "color": style.PAPER_COLOUR, "linestyle": line, "marker": marker, "markerfacecolor": "white", "linewidth": 0.7,
        "markersize": 3.5, "zorder": 1,
    }  # fmt: skip


def _handles(with_ours: bool) -> list[Line2D]:
    colour = style.look("safety-guard").colour
    handles = [
        Line2D([], [], color=colour, linestyle=line, marker=marker, label=f"fixed guard, {text}")
        for text, line, marker in STAGES.values()
    ]
    if with_ours:
        handles += [
            Line2D([], [], color=style.look(OURS).colour, linestyle=line, label=f"DD-RQ, {stage}")
            for stage, (_, line, _) in STAGES.items()
        ]
    return [*handles, Line2D([], [], label="the paper's guards", **_paper_look("T"))]
