"""The pictures of a risk report; the same data give the same bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from bench.replay.draw import importance_colour
from bench.risk.episodes import RiskEpisode
from bench.risk.rollouts import METHODS, Rollouts
from envs.actions import HORIZON_MAX_S, HORIZON_MIN_S
from envs.rendering import VIEW_M, Annotation, Colour, render_world
from envs.scenario import STEP_S
from envs.world import FloatArray

COLOURS: Final[Mapping[str, str]] = dict(zip(METHODS.values(), ("#0072b2", "#d55e00"), strict=True))
DPI: Final = 150
MARKED: Final = 2
"""Most important objects that are marked, as in the paper's figure."""


def write(figure: Figure, path: Path) -> None:
    """PNG and PDF beside each other, without the time of writing."""
    with matplotlib.rc_context({"pdf.fonttype": 42}):
        figure.savefig(path.with_suffix(".png"), dpi=DPI, metadata={"Software": None})
        figure.savefig(path.with_suffix(".pdf"), dpi=DPI, metadata={"CreationDate": None})


def planning_times(rollouts: Rollouts, models: Sequence[str]) -> Figure:
    """Distribution of the agent's T_c and of RQ."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    edges = np.linspace(HORIZON_MIN_S, HORIZON_MAX_S, 36)
    left.hist(rollouts.planning_times, edges, color="0.6", weights=_shares(rollouts.planning_times))
    left.set(xlabel="T_c of the driving agent [s]", ylabel="share of scenes")
    for method in models:
        risk = rollouts.risk(method)
        right.hist(
            risk, np.linspace(0.0, 100.0, 41), histtype="step", weights=_shares(risk), color=COLOURS[method],
            label=method,
        )  # fmt: skip
    right.set(xlabel="RQ [%]", ylabel="share of scenes", yscale="log")
    right.legend(frameon=False)
    return figure


def _shares(values: FloatArray) -> FloatArray:
    return np.full(len(values), 1.0 / len(values))


def reliability_plot(judged: Mapping[str, Mapping[str, Any]]) -> Figure:
    """RQ / 100 against the observed rate of contact within 3 s, a panel for each method."""
    figure = Figure(figsize=(4.0 * len(judged), 3.8), layout="constrained")
    panels = figure.subplots(1, len(judged), squeeze=False)[0]
    for panel, (method, figures) in zip(panels, judged.items(), strict=True):
        bins = figures["bins"]
        predicted, observed = ([row[key] for row in bins] for key in ("mean_predicted", "observed"))
        spread = [
            [row["observed"] - row["observed_low"] for row in bins],
            [row["observed_high"] - row["observed"] for row in bins],
        ]
        panel.plot([0.0, 1.0], [0.0, 1.0], color="0.7", lw=1.0)
        panel.errorbar(predicted, observed, spread, marker="o", ms=4, capsize=2, color=COLOURS[method])
        meaning = "a probability" if figures["is_probability"] else "a score, no probability"
        panel.set_title(f"{method}: {meaning}\ncalibration error {figures['expected_calibration_error']:.3f}", size=10)
        panel.set(xlabel="RQ / 100", ylabel="rate of contact within 3 s", xlim=(0.0, 1.0), ylim=(-0.02, 1.02))
    return figure


def _annotation(episode: RiskEpisode, method: str, step: int) -> Annotation:
    """Colours from green to red by IR; the two most important objects in the picture carry their rank and IR."""
    trace, importance = episode.trace, episode.importance[method][step]
    cars = trace.vehicles.shape[1]
    bodies = np.concatenate([trace.vehicles["s"][step], trace.pedestrians["s"][step]])
    in_view = np.abs(bodies - trace.ego["s"][step]) < 0.5 * VIEW_M
    order = [int(j) for j in np.argsort(-importance, kind="stable")]
    marked = [j for j in order if in_view[j]][:MARKED]
    ranks = {j: rank for rank, j in enumerate(order, 1) if j in marked}
    largest = float(importance.max(initial=0.0))
    colours: list[Colour | None] = [importance_colour(ir, largest) if ir > 0.0 else None for ir in importance]
    labels = [f"{ranks[j]}: IR {ir:.2f}" if j in ranks and ir > 0.0 else None for j, ir in enumerate(importance)]
    return Annotation(colours[:cars], labels[:cars], colours[cars:], labels[cars:])


def moments(risk: FloatArray) -> list[int]:
    """Steps that are shown, in order of time: of the lowest RQ, the highest, and the end."""
    return sorted({int(risk.argmin()), int(risk.argmax()), len(risk) - 1})


def episode_figure(episode: RiskEpisode, method: str) -> Figure:
    """RQ over time, and the scenes of lowest and highest RQ and of the end with IR in colour."""
    trace = episode.trace
    shown = moments(episode.risk[method])
    figure = Figure(figsize=(9.0, 2.4 + 2.0 * len(shown)), layout="constrained")
    panels = figure.subplots(1 + len(shown), 1, height_ratios=[1.3] + [1.0] * len(shown))
    seconds = np.arange(len(trace) + 1) * STEP_S
    for name, risk in episode.risk.items():
        panels[0].plot(seconds, risk, color=COLOURS[name], lw=1.4 if name == method else 0.7, label=name)
    for step in shown:
        panels[0].axvline(seconds[step], color="0.6", lw=0.8, ls="--")
    panels[0].set(xlabel="time [s]", ylabel="RQ [%]", xlim=(0.0, seconds[-1]), ylim=(-3.0, 103.0))
    panels[0].legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    for panel, step in zip(panels[1:], shown, strict=True):
        picture = render_world(trace.scenario, trace.world(step), 0, _annotation(episode, method, step))
        panel.imshow(picture, interpolation="none")
        panel.set_title(f"{seconds[step]:.1f} s, RQ {episode.risk[method][step]:.0f} % ({method})", size=9)
        panel.axis("off")
    return figure
