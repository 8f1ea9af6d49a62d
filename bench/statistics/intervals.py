"""Result values shared by all statistics."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.statistics import _checks


@dataclass(frozen=True)
class Interval:
    """A two-sided confidence interval; both bounds NaN where the data cannot give one.

    Attributes:
        low: Lower bound, in the unit of the estimate.
        high: Upper bound, >= low.
        level: Nominal coverage, in (0, 1).

    Raises:
        ValueError: The bounds are reversed, only one is NaN, or the level is outside (0, 1).
    """

    low: float
    high: float
    level: float = 0.95

    def __post_init__(self) -> None:
        """Refuse reversed bounds and impossible levels."""
        _checks.fraction("level", self.level)
        if not self.empty and not self.low <= self.high:
            raise ValueError(f"interval is [{self.low}, {self.high}]: pass low <= high, or two NaN for none")

    @classmethod
    def none(cls, level: float = 0.95) -> Interval:
        """The interval of an estimate that the data cannot bound."""
        return cls(math.nan, math.nan, level)

    @property
    def empty(self) -> bool:
        """Whether there is no interval."""
        return math.isnan(self.low) and math.isnan(self.high)

    @property
    def width(self) -> float:
        """High minus low, NaN if empty."""
        return self.high - self.low

    def contains(self, value: float) -> bool:
        """Whether low <= value <= high; False if empty."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Estimate:
    """A point value with its interval.

    Attributes:
        value: Point value; NaN where it is undefined.
        interval: Confidence interval, empty where the data cannot give one.
        replicates: Independent units behind the interval (seeds, groups or scenarios).
    """

    value: float
    interval: Interval
    replicates: int
