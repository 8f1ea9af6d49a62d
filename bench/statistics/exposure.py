"""Exposure: collisions per distance driven, with an exact Poisson interval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import SupportsIndex

from bench.statistics import _checks
from bench.statistics._distributions import gamma_quantile
from bench.statistics.intervals import Interval

REPORTING_DISTANCE_KM = 1000.0


@dataclass(frozen=True)
class Exposure:
    """Collisions per 1,000 km.

    Attributes:
        collisions: Number of collisions, >= 0.
        distance_km: Distance driven, >= 0 [km]; 0 gives a NaN value and an empty interval.
        interval: Confidence interval of `per_1000_km` [1 / 1,000 km].
    """

    collisions: int
    distance_km: float
    interval: Interval

    @property
    def per_1000_km(self) -> float:
        """Collisions per 1,000 km driven, NaN without distance."""
        return self.collisions / self.distance_km * REPORTING_DISTANCE_KM if self.distance_km else math.nan


def collisions_per_1000_km(collisions: SupportsIndex, distance_km: float, level: float = 0.95) -> Exposure:
    """Collisions per 1,000 km with the exact Poisson interval.

    Coverage is at least `level` if collisions come independently at a constant rate per kilometre, and above
    it for few collisions (the count is discrete). It leaves out differences between seeds.

    Source: Garwood (1936), Biometrika 28, as quantiles of the gamma distribution. With no collision the
    upper bound is -ln(0.025) = 3.69 per distance driven at level 0.95.

    Args:
        collisions: Number of collisions, >= 0.
        distance_km: Distance driven, >= 0 [km]; 0 gives NaN and an empty interval.
        level: Two-sided level, in (0, 1).

    Raises:
        ValueError: The count is negative or not whole, the distance is negative, infinite or 0 with
            collisions, or the level is outside (0, 1).
    """
    k = _checks.count("collisions", collisions)
    distance = float(distance_km)
    if not 0.0 <= distance < math.inf or (k > 0 and distance == 0.0):
        raise ValueError(f"distance_km is {distance_km!r} with {k} collisions: pass the kilometres driven")
    tail = (1.0 - _checks.fraction("level", level)) / 2.0
    if distance == 0.0:
        return Exposure(k, distance, Interval.none(level))
    scale = REPORTING_DISTANCE_KM / distance
    low = 0.0 if k == 0 else gamma_quantile(tail, k) * scale
    high = gamma_quantile(1.0 - tail, k + 1) * scale
    return Exposure(k, distance, Interval(low, high, level))
