"""Reliability of predicted probabilities: bins of prediction against outcome, and calibration error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import SupportsIndex

import numpy as np
import numpy.typing as npt

from bench.statistics import _checks
from bench.statistics.intervals import Interval
from bench.statistics.rates import exact_rate


@dataclass(frozen=True)
class ReliabilityBin:
    """Predictions in one range against what happened.

    Attributes:
        low: Lower edge of the predicted probability, included.
        high: Upper edge, excluded but for the last bin.
        samples: Predictions in the bin, >= 1.
        events: Events among them.
        mean_predicted: Mean predicted probability, in [low, high].
        interval: Clopper-Pearson interval of the observed rate; too narrow if samples share episodes.
    """

    low: float
    high: float
    samples: int
    events: int
    mean_predicted: float
    interval: Interval

    @property
    def observed(self) -> float:
        """Observed event rate in the bin."""
        return self.events / self.samples


@dataclass(frozen=True)
class Reliability:
    """Occupied bins in rising order, and the expected calibration error over them.

    Attributes:
        bins: Bins that hold at least one prediction.
        expected_calibration_error: Mean |observed - predicted| over bins, weighted by samples, in [0, 1].
    """

    bins: tuple[ReliabilityBin, ...]
    expected_calibration_error: float


def reliability(
    predicted: npt.ArrayLike, outcomes: npt.ArrayLike, bins: SupportsIndex = 10, level: float = 0.95
) -> Reliability:
    """Bin predicted probabilities in equal widths and compare each bin with its observed rate.

    Source: Guo et al. (2017), arXiv 1706.04599, Eq. (3), for the event's probability; bins are closed on the
    left, where theirs are closed on the right. With few samples a bin the error is biased upward.

    Args:
        predicted: Predicted probabilities, shape (samples,), in [0, 1].
        outcomes: 1 where the event followed, else 0, shape (samples,).
        bins: Number of bins of equal width over [0, 1], >= 1.
        level: Level of each bin's interval, in (0, 1).

    Raises:
        ValueError: Not one axis, empty, unequal lengths, predictions outside [0, 1], outcomes not 0 or 1.
    """
    forecasts = _checks.real_array("predicted", predicted, ndim=1)
    events = _checks.binary_array("outcomes", outcomes, ndim=1)
    _checks.same_shape("predicted", forecasts, "outcomes", events)
    bad = np.flatnonzero((forecasts < 0.0) | (forecasts > 1.0))
    if bad.size:
        raise ValueError(f"predicted holds {forecasts[bad[0]]:g} at index {bad[0]}: pass probabilities in [0, 1]")
    edges = np.linspace(0.0, 1.0, _checks.count("bins", bins, minimum=1) + 1)
    bin_of = np.clip(np.searchsorted(edges, forecasts, side="right") - 1, 0, edges.size - 2)
    rows = []
    for index in np.unique(bin_of):
        inside = bin_of == index
        samples, happened = int(inside.sum()), int(events[inside].sum())
        mean = float(np.mean(forecasts[inside]))
        interval = exact_rate(happened, samples, level).interval
        rows.append(ReliabilityBin(float(edges[index]), float(edges[index + 1]), samples, happened, mean, interval))
    gaps = sum(row.samples * abs(row.observed - row.mean_predicted) for row in rows)
    return Reliability(tuple(rows), gaps / forecasts.size)
