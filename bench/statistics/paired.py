"""Paired comparison of two methods on one frozen list of held-out scenarios."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import SupportsIndex

import numpy as np
import numpy.typing as npt

from bench.statistics import _checks
from bench.statistics._checks import FloatArray
from bench.statistics._distributions import fair_coin_tail
from bench.statistics.intervals import Estimate, Interval
from bench.statistics.resampling import t_interval


@dataclass(frozen=True)
class PairedScores:
    """Values of two methods on the same scenarios.

    Attributes:
        first_ids: Scenario ids of the first method, shape (scenarios,).
        first: Values of the first method, shape (seeds, scenarios).
        second_ids: Scenario ids of the second method; must equal `first_ids` in order.
        second: Values of the second method, shape (seeds, scenarios), same unit.

    Raises:
        ValueError: The id lists differ or repeat an id, or the shapes do not fit them.
    """

    first_ids: Sequence[Hashable]
    first: npt.ArrayLike
    second_ids: Sequence[Hashable]
    second: npt.ArrayLike

    def __post_init__(self) -> None:
        """Refuse lists and shapes that cannot be paired."""
        first, second = list(self.first_ids), list(self.second_ids)
        for place, (left, right) in enumerate(zip(first, second, strict=False)):
            if left != right:
                raise ValueError(
                    f"scenario ids differ at place {place}: {left!r} in first, {right!r} in second: "
                    "evaluate both on the one held-out list, in its order"
                )
        if len(first) != len(second):
            extra = (first if len(first) > len(second) else second)[min(len(first), len(second))]
            side = "second" if len(first) > len(second) else "first"
            raise ValueError(f"scenario id {extra!r} is missing from {side}: evaluate both on the one held-out list")
        if len(set(first)) != len(first):
            repeated = next(name for name in first if first.count(name) > 1)
            raise ValueError(f"scenario id {repeated!r} is repeated: list each scenario once, seeds as rows")
        for name, values in (("first", self.first), ("second", self.second)):
            array = _checks.real_array(name, values, ndim=2)
            if array.shape[1] != len(first):
                raise ValueError(
                    f"{name} has shape {array.shape} for {len(first)} scenario ids: pass (seeds, scenarios)"
                )


@dataclass(frozen=True)
class McNemar:
    """Outcome of McNemar's exact test.

    Attributes:
        both: Pairs in which both methods had the event.
        only_first: Pairs in which only the first had it.
        only_second: Pairs in which only the second had it.
        neither: Pairs without the event.
        p_value: Two-sided exact p value, in (0, 1].
    """

    both: int
    only_first: int
    only_second: int
    neither: int
    p_value: float


def mcnemar_exact(pairs: PairedScores) -> McNemar:
    """McNemar's exact two-sided test of equal event rates, on the pairs where the methods disagree.

    Under equal rates the discordant pairs split like fair coin tosses: p = min(1, 2 P(X <= min(b, c))),
    X ~ Binomial(b + c, 1/2); no discordant pair gives 1. Row s of one method is paired with row s of the
    other. It takes pairs as independent, so with several seeds it speaks for *these* trained policies on new
    scenarios; `paired_mean_difference` speaks for new seeds.

    Source: McNemar (1947), Psychometrika 12, with the exact binomial null distribution.

    Raises:
        ValueError: A value is not 0 or 1, or the methods have unequal numbers of seeds.
    """
    first, second = (_checks.binary_array(name, values, ndim=2) for name, values in _named(pairs))
    _checks.same_shape("first", first, "second", second)
    both = int(np.sum((first == 1.0) & (second == 1.0)))
    only_first = int(np.sum(first > second))
    only_second = int(np.sum(second > first))
    discordant = only_first + only_second
    tail = 0.5 if only_first == only_second else fair_coin_tail(min(only_first, only_second), discordant)
    return McNemar(both, only_first, only_second, first.size - both - discordant, min(1.0, 2.0 * tail))


def holm(p_values: npt.ArrayLike) -> FloatArray:
    """Holm's step-down adjusted p values, shape (tests,), in the order given.

    The i-th smallest of m is multiplied by m - i + 1, then made monotone and capped at 1; rejecting where the
    result is <= alpha keeps the family-wise error at alpha, whatever the dependence.

    Source: Holm (1979), Scandinavian Journal of Statistics 6.

    Args:
        p_values: Unadjusted p values, shape (tests,), in [0, 1].

    Raises:
        ValueError: A value lies outside [0, 1], or the array is empty.
    """
    values = _checks.real_array("p_values", p_values, ndim=1)
    bad = np.flatnonzero((values < 0.0) | (values > 1.0))
    if bad.size:
        raise ValueError(f"p_values holds {values[bad[0]]:g} at index {bad[0]}: pass values in [0, 1]")
    order = np.argsort(values, kind="stable")
    stepped = values[order] * np.arange(values.size, 0, -1)
    adjusted = np.empty_like(values)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(stepped))
    return adjusted


def paired_mean_difference(pairs: PairedScores, level: float = 0.95) -> Estimate:
    """Mean of first minus second with a t interval over seeds: speaks for new training seeds.

    Each seed gives the mean difference over the scenarios; t with seeds - 1 degrees of freedom. One seed
    gives an empty interval.

    Raises:
        ValueError: The level is outside (0, 1), or the methods have unequal numbers of seeds.
    """
    per_seed = np.mean(_differences(pairs), axis=1)
    _checks.fraction("level", level)
    seeds = per_seed.size
    error = float(np.std(per_seed, ddof=1)) / math.sqrt(seeds) if seeds > 1 else math.nan
    value = float(np.mean(per_seed))
    return Estimate(value, t_interval(value, error, seeds - 1, level), seeds)


def bootstrap_scenario_difference(
    pairs: PairedScores, rng: np.random.Generator, resamples: SupportsIndex = 2000, level: float = 0.95
) -> Estimate:
    """Mean of first minus second with a percentile bootstrap over scenarios: these policies, new scenarios.

    Scenarios are drawn whole, all seeds with them. It leaves out the luck of training: with seeds that
    differ, `paired_mean_difference` is the honest one. One scenario gives an empty interval.

    Args:
        pairs: Values of both methods.
        rng: Source of the resamples.
        resamples: Bootstrap samples, >= 100.
        level: Two-sided level, in (0, 1).

    Raises:
        ValueError: `rng` is not a Generator, too few resamples, level outside (0, 1), or unequal seeds.
    """
    per_scenario = np.mean(_differences(pairs), axis=0)
    tail = (1.0 - _checks.fraction("level", level)) / 2.0
    generator, scenarios = _checks.generator(rng), per_scenario.size
    drawn = _checks.count("resamples", resamples, minimum=100)
    value = float(np.mean(per_scenario))
    if scenarios < 2:
        return Estimate(value, Interval.none(level), scenarios)
    means = (np.mean(per_scenario[generator.integers(0, scenarios, size=scenarios)]) for _ in range(drawn))
    low, high = np.quantile(np.fromiter(means, dtype=np.float64, count=drawn), [tail, 1.0 - tail])
    return Estimate(value, Interval(float(low), float(high), level), scenarios)


def _named(pairs: PairedScores) -> tuple[tuple[str, npt.ArrayLike], tuple[str, npt.ArrayLike]]:
    return ("first", pairs.first), ("second", pairs.second)


def _differences(pairs: PairedScores) -> FloatArray:
    """First minus second, shape (seeds, scenarios)."""
    first, second = (_checks.real_array(name, values, ndim=2) for name, values in _named(pairs))
    _checks.same_shape("first", first, "second", second)
    return first - second
