"""Exact rates, zero claims and exposure: hand-worked values, exact coverage, and refusals."""

import math
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bench.statistics import (
    Interval,
    collisions_per_1000_km,
    episodes_for_zero_claim,
    exact_rate,
    format_rate,
    zero_event_bound,
)

LEVELS = st.sampled_from([0.8, 0.9, 0.95, 0.99])


@st.composite
def counts(draw: st.DrawFn) -> tuple[int, int]:
    trials = draw(st.integers(1, 20_000))
    return draw(st.integers(0, trials)), trials


def exact_coverage(rate: float, trials: int) -> float:
    """Coverage of the interval at a true rate: no simulation, a sum over all counts."""
    covered = [exact_rate(k, trials).interval.contains(rate) for k in range(trials + 1)]
    return float(stats.binom.pmf(np.arange(trials + 1), trials, rate) @ covered)


def test_one_event_in_two_trials_by_hand() -> None:
    # P(X >= 1) = 1 - (1 - p)^2 = 0.025 at the lower bound; P(X <= 1) = 1 - p^2 = 0.025 at the upper.
    rate = exact_rate(1, 2)
    assert rate.value == 0.5
    assert rate.low == pytest.approx(1.0 - math.sqrt(0.975), rel=1e-12)
    assert rate.high == pytest.approx(math.sqrt(0.975), rel=1e-12)


def test_no_event_and_only_events_by_hand() -> None:
    bound = 1.0 - 0.025 ** (1 / 10)
    assert astuple(exact_rate(0, 10).interval) == pytest.approx((0.0, bound, 0.95))
    assert astuple(exact_rate(10, 10).interval) == pytest.approx((1.0 - bound, 1.0, 0.95))


def test_no_trials_give_an_empty_value_not_a_crash() -> None:
    rate = exact_rate(0, 0)
    assert math.isnan(rate.value)
    assert rate.interval.empty
    assert not rate.interval.contains(0.0)
    assert math.isnan(rate.low)
    assert math.isnan(rate.high)
    assert math.isnan(rate.interval.width)
    assert format_rate(rate) == "0/0 (no episodes)"


@given(counts(), LEVELS)
def test_exact_interval_contains_the_point_and_mirrors(pair: tuple[int, int], level: float) -> None:
    k, n = pair
    rate, mirror = exact_rate(k, n, level), exact_rate(n - k, n, level)
    assert 0.0 <= rate.low <= rate.value <= rate.high <= 1.0
    assert rate.low == pytest.approx(1.0 - mirror.high, abs=1e-9)


@given(counts())
def test_exact_interval_shrinks_with_trials_and_grows_with_level(pair: tuple[int, int]) -> None:
    k, n = pair
    assert exact_rate(2 * k, 2 * n).interval.width < exact_rate(k, n).interval.width
    assert exact_rate(k, n, 0.9).interval.width < exact_rate(k, n).interval.width


@given(counts())
def test_exact_interval_equals_scipys(pair: tuple[int, int]) -> None:
    reference = stats.binomtest(*pair).proportion_ci(0.95, "exact")
    rate = exact_rate(*pair)
    assert (rate.low, rate.high) == pytest.approx((reference.low, reference.high), abs=1e-9)


@pytest.mark.parametrize(("rate", "trials"), [(0.03, 1000), (0.1, 400), (0.3, 400), (0.5, 1000)])
def test_exact_interval_covers_95_to_97_percent_of_common_events(rate: float, trials: int) -> None:
    assert 0.95 <= exact_coverage(rate, trials) <= 0.97


@pytest.mark.parametrize(("rate", "trials"), [(0.005, 400), (0.01, 100), (0.001, 2000), (0.01, 400)])
def test_exact_interval_is_conservative_for_rare_events(rate: float, trials: int) -> None:
    # One to four events expected: the count is discrete, so no exact interval reaches the 93 to 97 % here.
    assert 0.96 <= exact_coverage(rate, trials) <= 0.999


@pytest.mark.parametrize(
    ("events", "trials", "text"),
    [
        (12, 400, "12/400 = 3.0 % (1.6 to 5.2)"),
        (0, 400, "0/400 (<= 0.75 %)"),
        (0, 50_000, "0/50000 (<= 0.0060 %)"),
        (0, 1, "0/1 (<= 95.0 %)"),
        (3, 50_000, "3/50000 = 0.0060 % (0.0012 to 0.018)"),
        (5, 5, "5/5 = 100.0 % (47.8 to 100.0)"),
        (9_999, 10_000, "9999/10000 = 99.990 % (99.944 to 99.99975)"),
    ],
)
def test_rates_are_written_as_the_tables_need_them(events: int, trials: int, text: str) -> None:
    assert format_rate(exact_rate(events, trials)) == text


@given(st.integers(1, 10**7))
def test_written_zero_bound_never_claims_too_much(trials: int) -> None:
    written = float(format_rate(exact_rate(0, trials)).split("<= ")[1].split(" %")[0])
    assert written >= 100.0 * zero_event_bound(trials) - 1e-9


def test_zero_bound_by_hand() -> None:
    assert zero_event_bound(1) == pytest.approx(0.95)
    assert zero_event_bound(2) == pytest.approx(1.0 - math.sqrt(0.05))
    assert zero_event_bound(10_000) == pytest.approx(3.0 / 10_000, rel=0.01)  # the rule of three


@pytest.mark.parametrize(
    ("rate", "confidence", "episodes"),
    [(0.5, 0.75, 2), (0.5, 0.5, 1), (0.9, 0.5, 1), (0.01, 0.95, 299), (0.001, 0.95, 2995), (0.1, 0.999, 66)],
)
def test_episodes_for_a_zero_claim_by_hand(rate: float, confidence: float, episodes: int) -> None:
    assert episodes_for_zero_claim(rate, confidence) == episodes


@given(st.floats(1e-5, 0.9), st.floats(0.5, 0.999))
def test_episodes_for_a_zero_claim_are_the_fewest_that_do(rate: float, confidence: float) -> None:
    episodes = episodes_for_zero_claim(rate, confidence)
    assert zero_event_bound(episodes, confidence) <= rate * (1 + 1e-9)
    assert episodes == 1 or zero_event_bound(episodes - 1, confidence) > rate


def test_exposure_by_hand() -> None:
    # Poisson: P(0) = exp(-mu) = 0.025 at mu = 3.689; with one collision P(X >= 1) = 0.025 at -ln(0.975).
    none, one = collisions_per_1000_km(0, 500.0), collisions_per_1000_km(1, 2000.0)
    assert none.per_1000_km == 0.0
    assert astuple(none.interval) == pytest.approx((0.0, -2.0 * math.log(0.025), 0.95))
    assert one.per_1000_km == 0.5
    assert one.interval.low == pytest.approx(-0.5 * math.log(0.975))


@given(st.integers(0, 5000), st.floats(0.1, 1e6))
def test_exposure_contains_the_point_and_shrinks_with_distance(collisions: int, distance_km: float) -> None:
    short = collisions_per_1000_km(collisions, distance_km)
    long = collisions_per_1000_km(2 * collisions, 2 * distance_km)
    assert short.interval.contains(short.per_1000_km)
    assert long.interval.width < short.interval.width


def test_no_distance_gives_an_empty_exposure() -> None:
    nothing = collisions_per_1000_km(0, 0.0)
    assert math.isnan(nothing.per_1000_km)
    assert nothing.interval.empty


@pytest.mark.parametrize(("mean", "low", "high"), [(2.0, 0.96, 0.999), (200.0, 0.95, 0.965)])
def test_exposure_coverage_is_exact_for_many_and_conservative_for_few(mean: float, low: float, high: float) -> None:
    collisions = np.arange(int(mean + 20 * math.sqrt(mean)))
    covered = [collisions_per_1000_km(int(k), 1000.0).interval.contains(mean) for k in collisions]
    assert low <= float(stats.poisson.pmf(collisions, mean) @ covered) <= high


@pytest.mark.parametrize(
    ("events", "trials", "level", "message"),
    [
        (-1, 10, 0.95, "events is -1"),
        (3, 2, 0.95, "events 3 exceed trials 2"),
        (1, -2, 0.95, "trials is -2"),
        (math.nan, 2, 0.95, "events is nan: pass a whole number"),
        (1, 2, 95.0, r"level is 95\.0"),
        (1, 2, math.nan, "level is nan"),
    ],
)
def test_bad_counts_are_refused_by_value(events: int, trials: int, level: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        exact_rate(events, trials, level)


def test_impossible_claims_exposures_and_intervals_are_refused() -> None:
    with pytest.raises(ValueError, match="trials is 0"):
        zero_event_bound(0)
    with pytest.raises(ValueError, match=r"max_rate is 0\.0"):
        episodes_for_zero_claim(0.0)
    with pytest.raises(ValueError, match=r"distance_km is -1\.0"):
        collisions_per_1000_km(0, -1.0)
    with pytest.raises(ValueError, match=r"distance_km is 0\.0 with 1 collisions"):
        collisions_per_1000_km(1, 0.0)
    with pytest.raises(ValueError, match="pass low <= high"):
        Interval(1.0, 0.0)
    with pytest.raises(ValueError, match="two NaN for none"):
        Interval(math.nan, 0.0)


def test_numpy_counts_are_accepted() -> None:
    assert exact_rate(np.int64(1), np.int32(2)) == exact_rate(1, 2)


def test_situations_driven_by_several_policies_count_once():
    once, thrice = exact_rate(5, 100), exact_rate(15, 300, independent=100)
    assert (thrice.events, thrice.trials, thrice.independent) == (15, 300, 100)
    assert (thrice.low, thrice.high) == pytest.approx((once.low, once.high))
    assert exact_rate(15, 300).high < thrice.high
    assert format_rate(exact_rate(0, 300, independent=100)) == "0/300 (<= 3.0 %)"
    assert format_rate(exact_rate(0, 300)) == "0/300 (<= 1.00 %)"


@pytest.mark.parametrize("independent", [0, 301])
def test_there_are_as_many_situations_as_trials_or_fewer(independent):
    with pytest.raises(ValueError, match=f"independent {independent}"):
        exact_rate(15, 300, independent=independent)
