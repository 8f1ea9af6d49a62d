"""Spatio-temporal diagram of one held-out episode: every body as a box at each 0.1 s."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bench.errors import UsageError
from bench.plots import style
from bench.plots.data import Array, pick
from bench.records import Record
from bench.replay.held_out import replay
from bench.schema import column
from bench.shown import Runs
from envs.geometry import PEDESTRIAN_SIZE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.scenario import GOAL_M, LANE_WIDTH_M, LANES, STEP_S
from envs.trace import EpisodeTrace
from envs.world import CROSSING, Ending

DRIVERS: Final = ("dd-rq", "dd-rq-plus", "safety-guard", "cruise+guard", "cruise")
"""Whose episode is drawn: the first of these that there is."""
FRAME_MPS: Final = 10.0
"""The lanes are drawn in a frame that moves at this speed: in the road's own all lines would be one diagonal."""
EGO_COLOUR: Final = "#0072B2"
GUARDED_COLOUR: Final = "#000000"
"""Of the ego in steps in which the shield intervened."""
PEDESTRIAN_COLOUR: Final = "#D55E00"
TRAFFIC_COLOURS: Final = ("#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#7A5200")
LANE_NAMES: Final = ("right lane", "middle lane", "left lane")
AHEAD_M: Final = 130.0
BEHIND_M: Final = 50.0
"""Bodies farther from the ego than this are left out of the lanes [m]."""
SEEN_M: Final = 4.0
"""A pedestrian's box is drawn this long, or nobody would see it [m]."""


def draw(scenario: str, found: Sequence[Runs]) -> Figure | None:
    """Plan view of the road, and each lane over time; None without a policy that can drive here.

    Raises:
        RecordError: A file is not what was sealed.
        ReplayDiffersError: The episode comes out otherwise than it was recorded.
    """
    replayed = _replay(found)
    if replayed is None:
        return None
    label, trace = replayed
    figure, axes = style.figure(4, 1, 6.6, gridspec_kw={"height_ratios": [1.0, 1.5, 1.5, 1.5]})
    _plan(axes[0, 0], trace)
    for panel, lane in zip(axes[1:, 0], reversed(range(LANES)), strict=True):
        _lane(panel, trace, lane)
        panel.sharex(axes[1, 0])
        panel.sharey(axes[1, 0])
        panel.tick_params(labelbottom=lane == 0)
    axes[3, 0].set_xlabel("time [s]")
    axes[2, 0].set_ylabel(f"position minus {FRAME_MPS:g} m/s x time [m]")
    ending = Ending(trace.episode["ending"][-1]).name.lower().replace("_", "-")
    axes[0, 0].set_title(
        f"Scenario {scenario}: {label}, held-out episode {trace.number}, boxes every {STEP_S} s, end: {ending}",
        loc="left",
    )
    figure.legend(handles=_handles(trace), loc="outside lower center", ncols=5)
    return figure


def _replay(found: Sequence[Runs]) -> tuple[str, EpisodeTrace] | None:
    """Who drives, and his episode, checked against the record; None where no record has a policy.

    Raises:
        RecordError: A file is not what was sealed.
        ReplayDiffersError: The episode comes out otherwise than it was recorded.
    """
    for name in DRIVERS:
        for runs in pick(found, [name]):
            with contextlib.suppress(UsageError):
                (driven,) = replay(runs.records[0], [choose_episode(runs.records[0])])
                return style.look(name).label, driven.trace
    return None


def choose_episode(record: Record) -> int:
    """The first held-out episode with two lane changes and an intervention, or with two lane changes, or the first.

    A rule, so that nobody picks; an episode without an overtaking would show only parallel lines.
    """
    table = record.eval_episodes()
    changes, interventions = column(table, "lane_changes") >= 2, column(table, "interventions") > 0
    for wanted in (changes & interventions, changes):
        if wanted.any():
            return int(column(table, "episode")[np.argmax(wanted)])
    return 0


@dataclass(frozen=True, slots=True)
class _Body:
    """One body over the whole episode: arrays of shape (T + 1,)."""

    s: Array
    d: Array
    there: Array
    length_m: float
    width_m: float
    colour: str


def _bodies(trace: EpisodeTrace) -> list[_Body]:
    """The ego, then cars, then pedestrians."""
    everywhere = np.ones(len(trace) + 1, np.bool_)
    ego = _Body(trace.ego["s"], trace.ego["d"], everywhere, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M, EGO_COLOUR)
    cars = [
        _Body(car["s"], car["d"], car["present"] == 1, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M, _colour(k))
        for k, car in enumerate(trace.vehicles.T)
    ]
    side = PEDESTRIAN_SIZE_M
    people = [
        _Body(person["s"], person["d"], person["state"] == CROSSING, side, side, PEDESTRIAN_COLOUR)
        for person in trace.pedestrians.T
    ]
    return [ego, *cars, *people]


def _plan(axes: Axes, trace: EpisodeTrace) -> None:
    """The road from above: s to the right, d upwards; lanes much wider than true."""
    ego, *others = _bodies(trace)
    for body, alpha in [*((other, 0.1) for other in others), (ego, 0.35)]:
        there = body.there
        opacity = 0.9 if body.colour == PEDESTRIAN_COLOUR else alpha
        _boxes(axes, body.s[there], body.d[there], max(body.length_m, SEEN_M), body.width_m, body.colour, opacity)
    for edge in range(LANES + 1):
        solid = edge in (0, LANES)
        line = "-" if solid else (0, (6, 6))
        axes.axhline(
            (edge - LANES / 2) * LANE_WIDTH_M, color=style.GREY, linewidth=0.8 if solid else 0.5, linestyle=line
        )
    axes.set_xlim(0.0, GOAL_M)
    axes.set_ylim(-LANES * LANE_WIDTH_M / 2 - 0.7, LANES * LANE_WIDTH_M / 2 + 0.7)
    style.tidy(axes, "s [m]", "d [m]")
    axes.grid(False)


def _lane(axes: Axes, trace: EpisodeTrace, lane: int) -> None:
    """Bodies that overlap a lane, over time."""
    time = STEP_S * np.arange(len(trace) + 1)
    shift = FRAME_MPS * time
    centre = (lane - (LANES - 1) / 2) * LANE_WIDTH_M
    for body in reversed(_bodies(trace)):
        near = (body.s - trace.ego["s"] < AHEAD_M) & (trace.ego["s"] - body.s < BEHIND_M)
        inside = body.there & near & (np.abs(body.d - centre) < 0.5 * (LANE_WIDTH_M + body.width_m))
        _boxes(axes, time[inside], (body.s - shift)[inside], STEP_S, max(body.length_m, SEEN_M), body.colour, 0.9)
        if body.colour == EGO_COLOUR:
            flagged = inside & np.append(False, trace.intervened)
            _boxes(axes, time[flagged], (body.s - shift)[flagged], STEP_S, body.length_m, GUARDED_COLOUR, 1.0)
    axes.set_xlim(0.0, time[-1] + STEP_S)
    axes.autoscale_view(scalex=False)
    style.tidy(axes, "", "", LANE_NAMES[lane])


def _boxes(axes: Axes, x: Array, y: Array, width: float, height: float, colour: str, alpha: float) -> None:
    """A box around each (x, y)."""
    if not len(x):
        return
    corners = 0.5 * np.array([(-width, -height), (width, -height), (width, height), (-width, height)])
    polygons = np.stack([x, y], axis=1)[:, None, :] + corners
    axes.add_collection(PolyCollection(list(polygons), facecolors=colour, edgecolors="none", alpha=alpha))


def _colour(k: int) -> str:
    return TRAFFIC_COLOURS[k % len(TRAFFIC_COLOURS)]


def _handles(trace: EpisodeTrace) -> list[Patch]:
    cars = [Patch(color=_colour(k), label=f"car {k + 1}") for k in range(trace.vehicles.shape[1])]
    people = [Patch(color=PEDESTRIAN_COLOUR, label="pedestrian")] if trace.pedestrians.shape[1] else []
    ego = [Patch(color=EGO_COLOUR, label="ego")]
    ego += [Patch(color=GUARDED_COLOUR, label="ego, guard intervenes")] if trace.intervened.any() else []
    return [*ego, *cars, *people]
