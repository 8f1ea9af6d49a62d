"""How well a risk score orders outcomes: Spearman correlation and area under the ROC curve."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import SupportsIndex

import numpy as np
import numpy.typing as npt

from bench.statistics import _checks
from bench.statistics._checks import FloatArray, IntArray
from bench.statistics._distributions import t_quantile
from bench.statistics.intervals import Estimate, Interval
from bench.statistics.resampling import corrected_error, logit_t_interval

WeightedStatistic = Callable[[FloatArray], float]


def spearman(first: npt.ArrayLike, second: npt.ArrayLike) -> float:
    """Spearman's rank correlation, in [-1, 1], ties at mid-ranks; NaN if either is constant.

    Args:
        first: Samples, shape (samples,).
        second: Samples of the same instants, shape (samples,).

    Raises:
        ValueError: Not one axis, empty, not finite, or unequal lengths.
    """
    left, right = _pair("first", first, "second", second)
    return _spearman_statistic(left, right)(np.ones(left.size))


def spearman_interval(
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    rng: np.random.Generator,
    groups: npt.ArrayLike | None = None,
    resamples: SupportsIndex = 1000,
    level: float = 0.95,
) -> Estimate:
    """Spearman's rank correlation with a bootstrap interval on Fisher's z scale.

    Steps of one episode resemble each other: pass `groups` (the episode or seed of each sample), and whole
    groups are drawn. Corrected bootstrap standard error, t quantile with groups - 1 degrees of freedom. A
    constant input gives NaN and an empty interval; a perfect correlation gives a zero width. Simulated
    coverage: 98 % with 5 groups, 95 % with 20 and 200. Time grows with samples x resamples: thin 100,000
    samples first.

    Args:
        first: Samples, shape (samples,).
        second: Samples of the same instants, shape (samples,).
        rng: Source of the resamples.
        groups: Whole number per sample, shape (samples,); None draws single samples.
        resamples: Bootstrap samples, >= 100.
        level: Two-sided level, in (0, 1).

    Raises:
        ValueError: As `spearman`; or `groups` does not fit, `rng` is no Generator, too few resamples.
    """
    left, right = _pair("first", first, "second", second)
    statistic = _spearman_statistic(left, right)
    value = statistic(np.ones(left.size))
    error, units = _bootstrap_error(statistic, left.size, groups, rng, resamples)
    if math.isclose(abs(value), 1.0, abs_tol=1e-12):
        return Estimate(value, Interval(value, value, level), units)
    # Fisher's z of rho is half the log-odds of (1 + rho) / 2.
    half = _t_half_width(error, units, level) / 2.0
    share = logit_t_interval((1.0 + value) / 2.0, half, units, level)
    if share.empty:
        return Estimate(value, share, units)
    low, high = 2.0 * share.low - 1.0, 2.0 * share.high - 1.0
    return Estimate(value, Interval(min(low, value), max(high, value), level), units)


def area_under_curve(scores: npt.ArrayLike, outcomes: npt.ArrayLike) -> float:
    """Area under the ROC curve: P(score with event > score without), ties one half; NaN if one class only.

    Source: Hanley and McNeil (1982), Radiology 143: the Mann-Whitney form.

    Args:
        scores: Risk scores, larger = riskier, shape (samples,).
        outcomes: 1 where the event followed, else 0, shape (samples,).

    Raises:
        ValueError: Not one axis, empty, not finite, unequal lengths, or outcomes other than 0 and 1.
    """
    values, events = _scored("scores", scores, outcomes)
    return _auc_statistic(values, events)(np.ones(values.size))


def area_under_curve_interval(
    scores: npt.ArrayLike,
    outcomes: npt.ArrayLike,
    rng: np.random.Generator,
    groups: npt.ArrayLike | None = None,
    resamples: SupportsIndex = 1000,
    level: float = 0.95,
) -> Estimate:
    """Area under the ROC curve with a bootstrap interval on the log-odds scale.

    Grouping, correction and degrees of freedom as in `spearman_interval`. Simulated coverage with 5, 20 and
    200 groups: 93 to 96 %. A perfect order gets the exact binomial interval of min(events, non-events,
    groups) pairs; one class only gives NaN and no interval.

    Args:
        scores: Risk scores, larger = riskier, shape (samples,).
        outcomes: 1 where the event followed, else 0, shape (samples,).
        rng: Source of the resamples.
        groups: Whole number per sample, shape (samples,); None draws single samples.
        resamples: Bootstrap samples, >= 100.
        level: Two-sided level, in (0, 1).

    Raises:
        ValueError: As `area_under_curve`; or `groups` does not fit, `rng` is no Generator, too few resamples.
    """
    values, events = _scored("scores", scores, outcomes)
    statistic = _auc_statistic(values, events)
    value = statistic(np.ones(values.size))
    error, units = _bootstrap_error(statistic, values.size, groups, rng, resamples)
    pairs = max(1, min(units, int(events.sum()), int((1.0 - events).sum())))
    return Estimate(value, logit_t_interval(value, _t_half_width(error, units, level), pairs, level), units)


def _t_half_width(error: float, units: int, level: float) -> float:
    return t_quantile(0.5 + _checks.fraction("level", level) / 2.0, max(units - 1, 1)) * error


def _pair(
    first_name: str, first: npt.ArrayLike, second_name: str, second: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    left, right = (
        _checks.real_array(first_name, first, ndim=1),
        _checks.real_array(second_name, second, ndim=1),
    )
    _checks.same_shape(first_name, left, second_name, right)
    return left, right


def _scored(name: str, scores: npt.ArrayLike, outcomes: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    values, events = _pair(name, scores, "outcomes", outcomes)
    return values, _checks.binary_array("outcomes", events, ndim=1)


def _spearman_statistic(first: FloatArray, second: FloatArray) -> WeightedStatistic:
    """Spearman's correlation as a function of how often each sample counts; no sort per call."""
    left, right = _positions(first), _positions(second)

    def statistic(weights: FloatArray) -> float:
        total = weights.sum()
        x = _mid_ranks(left, weights) - total / 2.0
        y = _mid_ranks(right, weights) - total / 2.0
        variance = float((weights * x) @ x) * float((weights * y) @ y)
        if variance <= 1e-9:
            return math.nan
        return min(1.0, max(-1.0, float((weights * x) @ y) / math.sqrt(variance)))

    return statistic


def _auc_statistic(scores: FloatArray, events: FloatArray) -> WeightedStatistic:
    """Area under the ROC curve as a function of how often each sample counts."""
    positions = _positions(scores)

    def statistic(weights: FloatArray) -> float:
        positive = weights * events
        positives, total = float(positive.sum()), float(weights.sum())
        if positives in (0.0, total):
            return math.nan
        # The mid-ranks of the events sum to the pairs that they win, plus half the square of their number.
        won = float(positive @ _mid_ranks(positions, weights)) - positives**2 / 2.0
        return won / (positives * (total - positives))

    return statistic


def _positions(values: FloatArray) -> IntArray:
    """Index of each value among the sorted distinct values."""
    return np.asarray(np.unique(values, return_inverse=True)[1].ravel(), dtype=np.int64)


def _mid_ranks(positions: IntArray, weights: FloatArray) -> FloatArray:
    """Weight below each sample plus half of the weight tied with it, shape (samples,)."""
    mass = np.bincount(positions, weights=weights)
    return np.asarray((np.cumsum(mass) - mass / 2.0)[positions], dtype=np.float64)


def _bootstrap_error(
    statistic: WeightedStatistic,
    samples: int,
    groups: npt.ArrayLike | None,
    rng: np.random.Generator,
    resamples: SupportsIndex,
) -> tuple[float, int]:
    """Corrected standard error over resampled groups, and the number of groups."""
    members = np.arange(samples) if groups is None else _checks.count_array("groups", groups)
    if members.size != samples:
        raise ValueError(f"groups has {members.size} entries for {samples} samples: pass one group per sample")
    group_of = np.unique(members, return_inverse=True)[1].ravel()
    units = int(group_of.max()) + 1
    generator, drawn = _checks.generator(rng), _checks.count("resamples", resamples, minimum=100)
    values = np.empty(drawn)
    for index in range(drawn):
        counts = np.bincount(generator.integers(0, units, size=units), minlength=units)
        values[index] = statistic(counts[group_of].astype(np.float64))
    return corrected_error(values, units), units
