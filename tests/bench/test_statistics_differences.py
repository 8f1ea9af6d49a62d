"""Two methods over seeds: by hand, against scipy, properties, and simulated coverage with five seeds."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bench.statistics import mean_difference, mean_interval, mean_ratio, rate_difference, seed_rate

VALUES = st.lists(st.floats(0.1, 100.0).map(lambda value: round(value, 3)), min_size=2, max_size=6)


def test_mean_interval_by_hand() -> None:
    # 1, 2, 3: mean 2, error 1 / sqrt(3), t(2) = 4.3027.
    estimate, half = mean_interval([1, 2, 3]), 4.302652729911275 / math.sqrt(3)
    assert (estimate.value, estimate.replicates) == (2.0, 3)
    assert (estimate.interval.low, estimate.interval.high) == pytest.approx((2 - half, 2 + half))
    assert mean_interval([5.0]).interval.empty


def test_mean_difference_by_hand() -> None:
    # Means 4 and 2; variances of the means 4/3/3 ... of 2, 4, 6: 4 / 3; of 1, 3: 2 / 2 = 1; error sqrt(7/3).
    # Satterthwaite: (7/3)^2 / ((4/3)^2 / 2 + 1 / 1) = 2.8824.
    estimate = mean_difference([2, 4, 6], [1, 3])
    half = stats.t.ppf(0.975, (7 / 3) ** 2 / ((4 / 3) ** 2 / 2 + 1)) * math.sqrt(7 / 3)
    assert (estimate.value, estimate.replicates) == (2.0, 2)
    assert (estimate.interval.low, estimate.interval.high) == pytest.approx((2 - half, 2 + half))


def test_mean_difference_equals_scipys_welch() -> None:
    first, second = np.random.default_rng(1).normal(size=5), np.random.default_rng(2).normal(3.0, 4.0, size=3)
    reference = stats.ttest_ind(first, second, equal_var=False).confidence_interval(0.9)
    interval = mean_difference(first, second, level=0.9).interval
    assert (interval.low, interval.high) == pytest.approx((reference.low, reference.high))


def test_mean_ratio_by_hand() -> None:
    # Means 2 and 4: ratio 1/2. Variances of the log means: (1/3) / 4 and (4/3) / 16, both 1/12; 4 degrees.
    estimate = mean_ratio([1, 2, 3], [2, 4, 6])
    half = 2.7764451051977987 * math.sqrt(1 / 6)
    assert estimate.value == 0.5
    assert (estimate.interval.low, estimate.interval.high) == pytest.approx(
        (0.5 * math.exp(-half), 0.5 * math.exp(half))
    )


def test_rate_difference_by_hand() -> None:
    first, second = seed_rate([4, 6], [10, 10]), seed_rate([1, 3], [10, 10])
    a, b = first.interval, second.interval
    estimate = rate_difference(first, second)
    assert estimate.value == pytest.approx(0.3)
    assert estimate.interval.low == pytest.approx(0.3 - math.sqrt((0.5 - a.low) ** 2 + (b.high - 0.2) ** 2))
    assert estimate.interval.high == pytest.approx(0.3 + math.sqrt((a.high - 0.5) ** 2 + (0.2 - b.low) ** 2))


@given(VALUES, VALUES)
def test_exchanging_the_methods_mirrors_every_interval(first: list[float], second: list[float]) -> None:
    there, back = mean_difference(first, second), mean_difference(second, first)
    assert there.interval.low == pytest.approx(-back.interval.high, abs=1e-9)
    over, under = mean_ratio(first, second), mean_ratio(second, first)
    assert over.interval.low == pytest.approx(1.0 / under.interval.high)
    assert over.interval.contains(over.value) or over.interval.width < 1e-9
    assert mean_difference(first[::-1], second).value == pytest.approx(there.value)


@given(st.lists(st.integers(0, 50), min_size=2, max_size=5), st.lists(st.integers(0, 50), min_size=2, max_size=5))
def test_a_rate_difference_contains_its_value_and_mirrors(first: list[int], second: list[int]) -> None:
    one, other = seed_rate(first, [50] * len(first)), seed_rate(second, [50] * len(second))
    there, back = rate_difference(one, other), rate_difference(other, one)
    assert there.interval.low - 1e-12 <= there.value <= there.interval.high + 1e-12
    assert there.interval.low == pytest.approx(-back.interval.high, abs=1e-12)


def test_what_cannot_be_bounded_has_no_interval() -> None:
    assert mean_difference([1.0], [2.0, 3.0]).interval.empty
    assert mean_difference([1.0, 1.0], [3.0, 3.0]).interval.width == 0.0
    assert mean_ratio([1.0], [2.0, 3.0]).interval.empty
    assert (mean_ratio([0, 0], [1, 2]).value, mean_ratio([0, 0], [1, 2]).interval.high) == (0.0, 0.0)
    assert mean_ratio([0], [1, 2]).interval.empty
    assert math.isnan(mean_ratio([1.0, 2.0], [0.0, 0.0]).value)
    assert rate_difference(seed_rate([0], [0]), seed_rate([1, 2], [9, 9])).interval.empty


def test_values_that_cannot_be_compared_are_refused() -> None:
    with pytest.raises(ValueError, match="first holds nan at flat index 1"):
        mean_difference([1.0, math.nan], [1.0])
    with pytest.raises(ValueError, match=r"second holds -1 at index 1: a ratio needs values >= 0"):
        mean_ratio([1.0], [1.0, -1.0])
    with pytest.raises(ValueError, match=r"first has level 0\.95 but second has 0\.9"):
        rate_difference(seed_rate([1], [9]), seed_rate([1], [9], level=0.9))


@pytest.mark.parametrize(("spreads", "seeds"), [((1.0, 1.0), (5, 5)), ((1.0, 3.0), (5, 5)), ((2.0, 1.0), (3, 5))])
def test_mean_difference_covers_93_to_97_percent(spreads: tuple[float, float], seeds: tuple[int, int]) -> None:
    rng = np.random.default_rng(31)
    pairs = ((rng.normal(0.5, spreads[0], seeds[0]), rng.normal(0.0, spreads[1], seeds[1])) for _ in range(3000))
    assert 0.93 <= np.mean([mean_difference(*pair).interval.contains(0.5) for pair in pairs]) <= 0.97


@pytest.mark.parametrize("spreads", [(0.05, 0.05), (0.3, 0.1), (0.3, 0.3)])
def test_mean_ratio_covers_93_to_97_percent(spreads: tuple[float, float]) -> None:
    rng = np.random.default_rng(32)
    pairs = ((rng.gamma(s**-2, s**2, 5) for s in spreads) for _ in range(3000))
    assert 0.93 <= np.mean([mean_ratio(*pair).interval.contains(1.0) for pair in pairs]) <= 0.97


@pytest.mark.parametrize("rates", [(0.3, 0.1), (0.5, 0.0), (0.5, 0.02)])
def test_rate_difference_covers_93_to_97_percent(rates: tuple[float, float]) -> None:
    rng, spread = np.random.default_rng(33), 1 / 0.02 - 1
    covered = []
    for _ in range(2000):
        drawn = [rng.beta(r * spread, (1 - r) * spread, 5) if r else np.zeros(5) for r in rates]
        both = [seed_rate(rng.binomial(10_000, r), [10_000] * 5) for r in drawn]
        covered.append(rate_difference(*both).interval.contains(rates[0] - rates[1]))
    assert 0.93 <= np.mean(covered) <= 0.97
