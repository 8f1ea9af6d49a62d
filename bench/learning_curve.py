"""Training seen over time: means of the episodes that ended in each window of steps."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bench.records import Record
from bench.schema import column
from envs.scenario import STEP_S
from envs.world import Ending

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class LearningCurve:
    """One run's training, window by window; NaN where no episode ended.

    Attributes:
        start: First step of each window, exclusive, shape (W,) [simulation steps of 0.1 s].
        stop: Last step, inclusive, shape (W,).
        wall_s: Seconds since training began at the end of each window, shape (W,); NaN without a timeline.
        episodes: Episodes that ended in it, shape (W,).
        returns: Mean of return_driving + return_comfort, shape (W,).
        collision_rates: Share that ended in a collision, shape (W,).
        speeds_mps: Mean of distance / time, shape (W,) [m/s].
        intervention_ratios: Flagged steps / all steps, shape (W,).
    """

    start: Array
    stop: Array
    wall_s: Array
    episodes: Array
    returns: Array
    collision_rates: Array
    speeds_mps: Array
    intervention_ratios: Array


@functools.cache
def of(record: Record, width: int) -> LearningCurve:
    """The curve of a run in whole windows of so many steps; what is left at the end is left out.

    Args:
        record: The run.
        width: Simulation steps in a window, at least 1.

    Raises:
        ValueError: The width is below 1.
        RecordError: The training episodes cannot be used.
    """
    if width < 1:
        raise ValueError(f"width = {width}: pass at least one step.")
    windows = record.spec.steps // width
    stop = width * np.arange(1, windows + 1)
    table = record.train_episodes()
    data = {name: column(table, name).astype(np.float64) for name in _COLUMNS}
    # An episode that ends with the last step of a window belongs to that window.
    window = np.searchsorted(stop, data["end_step"], side="left")
    inside = window < windows

    def total(values: Array) -> Array:
        summed: Array = np.bincount(window[inside], weights=values[inside], minlength=windows)
        return summed

    episodes = total(np.ones_like(data["end_step"]))
    steps = total(data["steps"])
    with np.errstate(invalid="ignore"):
        return LearningCurve(
            stop - width,
            stop,
            _wall_seconds(record, stop),
            episodes.astype(np.int64),
            total(data["return_driving"] + data["return_comfort"]) / episodes,
            total(data["ending"] == Ending.COLLISION) / episodes,
            total(data["distance"] / (STEP_S * data["steps"])) / episodes,
            total(data["interventions"]) / steps,
        )


_COLUMNS = ("end_step", "steps", "return_driving", "return_comfort", "ending", "distance", "interventions")


def _wall_seconds(record: Record, steps: Array) -> Array:
    """Seconds at which so many steps were done, between the points of the run's timeline."""
    points = np.array([[0, 0.0], *record.details.get("timeline", [])])
    if len(points) < 2:
        return np.full(len(steps), np.nan)
    seconds: Array = np.interp(steps, points[:, 0], points[:, 1])
    return seconds
