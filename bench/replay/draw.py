"""Replays as films and pictures, one above the other where two are compared."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import imageio.v2 as imageio
import numpy as np

from bench.replay.held_out import Replay
from envs.rendering import Annotation, Colour, Frame, note_interventions, render_world, write_film
from envs.scenario import STEP_S
from envs.world import FloatArray

CALM: Final[Colour] = (60, 170, 75)
URGENT: Final[Colour] = (220, 50, 47)
"""Colours of the least and the most important body."""
MOMENTS: Final = 5
"""Pictures on a sheet."""
GIF_EVERY: Final = 2
"""Steps of 0.1 s from one picture of a GIF to the next: its files grow large."""


def importance_colour(importance: float, largest: float) -> Colour:
    """Green for what the guard weighs least, red for what it weighs most."""
    share = importance / largest if largest > 0.0 else 0.0
    mixed = [round(low + share * (high - low)) for low, high in zip(CALM, URGENT, strict=True)]
    return mixed[0], mixed[1], mixed[2]


def annotation(replay: Replay, step: int) -> Annotation:
    """What the guard knew in the step that led here: importance over bodies, T_c, RQ, what it changed."""
    trace, guard = replay.trace, replay.guard
    note = f"episode {trace.number}" + ("" if replay.exact else ", to rounding")
    lines = [f"{replay.title}, {note}"]
    if guard is None or not len(trace):
        return Annotation(lines=[*lines, *note_interventions(trace, step).lines])
    at = max(step - 1, 0)
    known = [f"T_c {guard.tc_s[at]:.2f} s"]
    if math.isfinite(guard.risk_percent[at]):
        known.append(f"RQ {guard.risk_percent[at]:.0f} %")
    if math.isfinite(guard.limit_ahead_mps2[at]):
        known.append(f"at most {guard.limit_ahead_mps2[at]:+.2f} m/s²")
    lines.append("; ".join([", ".join(known), *note_interventions(trace, step).lines]))
    cars = trace.vehicles.shape[1]
    colours, labels = _by_importance(guard.importance[at])
    return Annotation(colours[:cars], labels[:cars], colours[cars:], labels[cars:], lines)


def _by_importance(importance: FloatArray) -> tuple[list[Colour | None], list[str | None]]:
    largest = float(importance.max(initial=0.0))
    seen = importance > 0.0
    colours = [importance_colour(ir, largest) if some else None for ir, some in zip(importance, seen, strict=True)]
    labels = [f"{100.0 * ir:.0f} %" if some else None for ir, some in zip(importance, seen, strict=True)]
    return colours, labels


def picture(replay: Replay, step: int) -> Frame:
    """The state after so many steps, or the last one."""
    step = min(step, len(replay.trace))
    return render_world(replay.trace.scenario, replay.trace.world(step), 0, annotation(replay, step))


def pictures(replays: Sequence[Replay], every: int = 1) -> Iterator[Frame]:
    """Pictures of episodes that begin together, one above the other; one that has ended waits for the rest."""
    last = max(len(replay.trace) for replay in replays)
    for step in [*range(0, last, every), last]:
        yield np.concatenate([picture(replay, step) for replay in replays])


def closest_step(replay: Replay) -> int:
    """Steps done when the time to collision was least; the last step where it never closed in."""
    least = replay.trace.episode["ttc_min"]
    return int(np.argmin(least)) if math.isfinite(least[-1]) else len(replay.trace)


def sheet(replays: Sequence[Replay]) -> Frame:
    """Five moments of each episode from top to bottom, the closest call among them; episodes side by side."""
    first = replays[0]
    steps = np.linspace(0, max(len(replay.trace) for replay in replays), MOMENTS).round().astype(int)
    inner = steps[1:-1]
    inner[np.argmin(np.abs(inner - closest_step(first)))] = closest_step(first)
    rows = [*steps[:1], *sorted(inner), *steps[-1:]]
    columns = [np.concatenate([picture(replay, int(step)) for step in rows]) for replay in replays]
    return np.concatenate(columns, axis=1)


def write_picture(replays: Sequence[Replay], path: Path) -> int:
    """Write a sheet, PNG; the number of moments on it."""
    imageio.imwrite(path, sheet(replays))
    return MOMENTS


def write_moving(replays: Sequence[Replay], path: Path) -> int:
    """Write a film in real time, MP4 or GIF; the number of its pictures."""
    every = GIF_EVERY if path.suffix == ".gif" else 1
    return write_film(pictures(replays, every), path, 1.0 / (STEP_S * every))
