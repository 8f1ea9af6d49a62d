"""Bootstrap over few replicates, with the small-sample correction that makes it cover."""

from __future__ import annotations

import math
from typing import SupportsIndex

import numpy as np

from bench.statistics import _checks
from bench.statistics._checks import FloatArray, IntArray
from bench.statistics._distributions import expit, logit, t_quantile
from bench.statistics.intervals import Interval
from bench.statistics.rates import exact_rate


def replicate_counts(rng: np.random.Generator, replicates: int, resamples: SupportsIndex) -> IntArray:
    """How often each replicate appears in each bootstrap sample, shape (resamples, replicates).

    Raises:
        ValueError: `rng` is not a numpy Generator or there are fewer than 100 resamples.
    """
    drawn = _checks.count("resamples", resamples, minimum=100)
    weights = np.full(replicates, 1.0 / replicates)
    return np.asarray(_checks.generator(rng).multinomial(replicates, weights, size=drawn), dtype=np.int64)


def corrected_error(resampled: FloatArray, replicates: int) -> float:
    """Standard error from bootstrap values, shape (resamples,), times sqrt(m / (m - 1)); NaN if m < 2.

    A sample of m replicates spreads sqrt((m - 1) / m) less than its population: 11 % too little with five
    seeds. Resamples without a defined value (NaN) are left out.

    Source: Hesterberg (2015), The American Statistician 69(4), section on narrowness bias.
    """
    defined = resampled[np.isfinite(resampled)]
    if replicates < 2 or defined.size < 2:
        return math.nan
    return float(np.std(defined, ddof=1)) * math.sqrt(replicates / (replicates - 1))


def t_interval(value: float, error: float, degrees: float, level: float) -> Interval:
    """Value -/+ t quantile times standard error; empty if either is NaN."""
    if math.isnan(value) or math.isnan(error):
        return Interval.none(level)
    half = t_quantile(0.5 + level / 2.0, degrees) * error
    return Interval(value - half, value + half, level)


def logit_t_interval(value: float, half_width: float, units: int, level: float) -> Interval:
    """Interval for a probability, symmetric on the log-odds scale, so inside [0, 1].

    Source: delta method, d logit(p) / dp = 1 / (p (1 - p)). At 0 and 1 the log-odds diverge; there the exact
    binomial interval of `units` independent units that all agree takes over.

    Args:
        value: Probability, in [0, 1].
        half_width: Half the width before the transformation, >= 0; NaN gives an empty interval.
        units: Independent units that agree when `value` is 0 or 1, >= 1.
        level: Two-sided level, in (0, 1).
    """
    if math.isnan(value) or math.isnan(half_width):
        return Interval.none(level)
    spread = value * (1.0 - value)
    if spread <= 1e-12:
        return exact_rate(units if value > 0.5 else 0, units, level).interval
    centre, half = logit(value), half_width / spread
    low, high = expit(centre - half), expit(centre + half)
    return Interval(min(low, value), max(high, value), level)
