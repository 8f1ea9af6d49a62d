"""Rates of rare events: exact intervals, what a zero means, and how to write both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import SupportsIndex

from bench.statistics import _checks
from bench.statistics._distributions import beta_quantile
from bench.statistics.intervals import Interval


@dataclass(frozen=True)
class Rate:
    """Events in trials with an interval for the rate, as fractions in [0, 1].

    Attributes:
        events: Number of trials with the event, 0 to `trials`.
        trials: Number of trials; 0 gives a NaN value and an empty interval.
        interval: Confidence interval of the rate.
        independent: Trials that count as independent, at most `trials`.
    """

    events: int
    trials: int
    interval: Interval
    independent: int

    @property
    def value(self) -> float:
        """Events / trials, NaN without trials."""
        return self.events / self.trials if self.trials else math.nan

    @property
    def low(self) -> float:
        """Lower bound, NaN without trials."""
        return self.interval.low

    @property
    def high(self) -> float:
        """Upper bound, NaN without trials."""
        return self.interval.high


def exact_rate(
    events: SupportsIndex, trials: SupportsIndex, level: float = 0.95, independent: SupportsIndex | None = None
) -> Rate:
    """Rate with the exact Clopper-Pearson interval for independent trials.

    Coverage is at least `level` for every true rate, and above it for rare events: the count is discrete
    (about 98 % at two expected events). Trials of one trained policy share its luck, so across seeds use
    `bench.statistics.seed_rate`.

    Several policies that drive the same situations are not so many independent trials: what one does in a
    situation, the others tend to do. How alike they are is not known for events that were not seen, so that
    the worst is assumed, entirely: the interval is that of `independent` trials at the same rate.

    Source: Clopper and Pearson (1934), Biometrika 26, as quantiles of the beta distribution; the effective number
    of trials of clusters with intra-class correlation 1: Kish, Survey Sampling (1965), section 5.4.

    Args:
        events: Trials with the event, 0 to `trials`.
        trials: Trials, >= 0; 0 gives NaN and an empty interval.
        level: Two-sided level, in (0, 1).
        independent: Distinct situations among the trials, 1 to `trials`; all of them unless given.

    Raises:
        ValueError: A count is negative or not whole, events exceed trials, situations exceed trials, or the level
            is outside (0, 1).
    """
    k, n = _checks.count("events", events), _checks.count("trials", trials)
    if k > n:
        raise ValueError(f"events {k} exceed trials {n}: count each trial once, and events among the same trials")
    distinct = n if independent is None else _checks.count("independent", independent)
    if not min(n, 1) <= distinct <= n:
        raise ValueError(f"independent {distinct}: must be 1 to {n}, the number of trials")
    tail = (1.0 - _checks.fraction("level", level)) / 2.0
    if n == 0:
        return Rate(k, n, Interval.none(level), distinct)
    seen = k * distinct / n
    low = 0.0 if k == 0 else beta_quantile(tail, seen, distinct - seen + 1)
    high = 1.0 if k == n else beta_quantile(1.0 - tail, seen + 1, distinct - seen)
    return Rate(k, n, Interval(low, high, level), distinct)


def zero_event_bound(trials: SupportsIndex, confidence: float = 0.95) -> float:
    """One-sided upper bound of a rate after no event in `trials` trials: 1 - (1 - confidence)^(1/trials).

    Source: the one-sided Clopper-Pearson bound at 0; close to the rule of three, 3 / trials.

    Args:
        trials: Independent trials without an event, >= 1.
        confidence: One-sided confidence, in (0, 1).

    Raises:
        ValueError: There are no trials, or the confidence is outside (0, 1).
    """
    n = _checks.count("trials", trials, minimum=1)
    return -math.expm1(math.log1p(-_checks.fraction("confidence", confidence)) / n)


def episodes_for_zero_claim(max_rate: float, confidence: float = 0.95) -> int:
    """Fewest episodes, all without a collision, that show rate <= `max_rate` at `confidence`.

    Source: smallest n with (1 - max_rate)^n <= 1 - confidence. One collision voids the claim: plan more.
    The episodes must be independent; those of one policy speak for that policy only.

    Args:
        max_rate: Largest rate to be claimed, in (0, 1), per episode.
        confidence: One-sided confidence, in (0, 1).

    Raises:
        ValueError: An argument is outside (0, 1).
    """
    survive = math.log1p(-_checks.fraction("max_rate", max_rate))
    doubt = math.log1p(-_checks.fraction("confidence", confidence))
    ratio = doubt / survive
    # The quotient of a whole number of episodes may come out a rounding error too high.
    nearest = round(ratio)
    exact = nearest >= 1 and math.isclose(ratio, nearest, rel_tol=1e-12)
    return nearest if exact else math.ceil(ratio)


def format_rate(rate: Rate) -> str:
    """A rate as the tables write it, in percent.

    `12/400 = 3.0 % (1.6 to 5.2)`; a zero as `0/400 (<= 0.75 %)` with the one-sided bound of the independent trials
    at the interval's level, rounded up; no trials as `0/0 (no episodes)`. Near 0 and 100 % two significant digits
    stay.
    """
    if rate.trials == 0:
        return f"{rate.events}/0 (no episodes)"
    head = f"{rate.events}/{rate.trials}"
    if rate.events == 0:
        bound = 100.0 * zero_event_bound(rate.independent, rate.interval.level)
        places = _decimals(bound)
        rounded_up = math.ceil(bound * 10**places - 1e-9) / 10**places
        return f"{head} (<= {rounded_up:.{places}f} %)"
    return f"{head} = {_percent(rate.value)} % ({_percent(rate.low)} to {_percent(rate.high)})"


def _percent(fraction: float) -> str:
    percent = 100.0 * fraction
    return f"{percent:.{_decimals(percent)}f}"


def _decimals(percent: float) -> int:
    """Decimals that keep two significant digits of the distance to 0 or 100 %, at least one."""
    distance = min(percent, 100.0 - percent)
    if distance <= 0.0 or distance >= 1.0:
        return 1
    return min(12, 1 - math.floor(math.log10(distance)))
