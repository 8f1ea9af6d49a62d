"""Rates over seeds: hand-worked intervals, and simulated coverage with five seeds.

Coverage is simulated with the shipped function and fixed generators: the figures are the same on each run.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.statistics import SeedInterval, exact_rate, percentile_seed_rate, seed_rate

SEEDS = 5
PER_SEED = st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


def expit(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))


def draw_events(
    rng: np.random.Generator, rate: float, correlation: float, trials: list[int], repetitions: int
) -> np.ndarray:
    """Events per seed, shape (repetitions, seeds); each seed's rate is beta distributed."""
    shape = (repetitions, len(trials))
    spread = 1.0 / correlation - 1.0 if correlation else 0.0
    rates = rng.beta(rate * spread, (1 - rate) * spread, shape) if correlation else np.full(shape, rate)
    return rng.binomial(trials, rates)


def coverage(rate: float, correlation: float, trials: list[int], repetitions: int = 2000, stream: int = 0) -> float:
    rng = np.random.default_rng([20_260_101, stream])
    events = draw_events(rng, rate, correlation, trials, repetitions)
    return float(np.mean([seed_rate(row, trials).interval.contains(rate) for row in events]))


def test_equal_seeds_by_hand() -> None:
    # Seed rates 0.1, 0.2, 0.3: mean 0.2, standard error 0.1 / sqrt(3), t(2) = 4.3027; d logit = 1 / 0.16.
    result = seed_rate([1, 2, 3], [10, 10, 10])
    half = 4.302652729911275 * 0.1 / math.sqrt(3) / 0.16
    assert (result.events, result.trials, result.seeds) == (6, 30, 3)
    assert result.value == 0.2
    assert result.method is SeedInterval.LOGIT_T
    assert result.interval.low == pytest.approx(expit(math.log(0.25) - half), rel=1e-9)
    assert result.interval.high == pytest.approx(expit(math.log(0.25) + half), rel=1e-9)


def test_unequal_seeds_by_hand() -> None:
    # Rate 7/30; residuals -4/3 and 4/3, over 1 - n/N = 2/3 and 1/3: -2 and 4; variance 1/2 (4 + 16) / 30^2.
    rate, error = 7 / 30, math.sqrt(10) / 30
    half = 12.706204736174694 * error / (rate * (1 - rate))
    result = seed_rate([1, 6], [10, 20])
    assert result.interval.low == pytest.approx(expit(math.log(7 / 23) - half), rel=1e-9)
    assert result.interval.high == pytest.approx(expit(math.log(7 / 23) + half), rel=1e-9)


def test_seeds_that_agree_exactly_keep_half_the_binomial_width() -> None:
    result = seed_rate([20] * 5, [100] * 5)
    half = 0.5 * 1.959963984540054 / math.sqrt(500 * 0.2 * 0.8)
    assert result.interval.low == pytest.approx(expit(math.log(0.25) - half), rel=1e-9)
    assert result.interval.high == pytest.approx(expit(math.log(0.25) + half), rel=1e-9)


@pytest.mark.parametrize("events", [[0] * 5, [400] * 5])
def test_all_zero_and_all_one_fall_back_to_pooled_clopper_pearson(events: list[int]) -> None:
    result = seed_rate(events, [400] * 5)
    assert result.method is SeedInterval.CLOPPER_PEARSON
    assert result.interval == exact_rate(sum(events), 2000).interval


def test_one_seed_falls_back_and_says_so() -> None:
    result = seed_rate([3], [100])
    assert result.method is SeedInterval.CLOPPER_PEARSON
    assert result.interval == exact_rate(3, 100).interval


def test_seeds_without_trials_are_left_out_and_none_at_all_is_empty() -> None:
    assert seed_rate([1, 0, 3], [10, 0, 10]) == seed_rate([1, 3], [10, 10])
    nothing = seed_rate([0, 0], [0, 0])
    assert math.isnan(nothing.value)
    assert nothing.interval.empty
    assert percentile_seed_rate([0], [0], np.random.default_rng(0)).interval.empty


@given(st.lists(PER_SEED, min_size=1, max_size=8), st.randoms(use_true_random=False))
def test_interval_contains_the_rate_whatever_the_order(pairs: list[tuple[int, int]], shuffler) -> None:
    first = seed_rate(*zip(*pairs, strict=True))
    shuffler.shuffle(pairs)
    second = seed_rate(*zip(*pairs, strict=True))
    assert 0.0 <= first.interval.low <= first.value <= first.interval.high <= 1.0
    assert second.interval.low == pytest.approx(first.interval.low, rel=1e-9, abs=1e-12)
    assert second.interval.high == pytest.approx(first.interval.high, rel=1e-9, abs=1e-12)


@given(st.lists(PER_SEED, min_size=2, max_size=6))
def test_twice_the_seeds_shrink_the_interval(pairs: list[tuple[int, int]]) -> None:
    once, twice = (seed_rate(*zip(*(pairs * times), strict=True)).interval for times in (1, 2))
    assert twice.width <= once.width


@given(st.lists(PER_SEED, min_size=2, max_size=6))
def test_the_interval_of_a_lower_level_lies_inside_that_of_a_higher_one(pairs: list[tuple[int, int]]) -> None:
    events, trials = zip(*pairs, strict=True)
    inner, outer = (seed_rate(events, trials, level).interval for level in (0.8, 0.95))
    assert outer.low <= inner.low <= inner.high <= outer.high


@pytest.mark.parametrize(
    ("rate", "correlation", "episodes"),
    [(0.03, 0.0, 400), (0.3, 0.0, 100), (0.1, 0.005, 400), (0.03, 0.02, 400), (0.3, 0.1, 10_000)],
)
def test_seed_interval_covers_93_to_97_percent(rate: float, correlation: float, episodes: int) -> None:
    assert 0.93 <= coverage(rate, correlation, [episodes] * SEEDS) <= 0.97


@pytest.mark.slow
@pytest.mark.parametrize("episodes", [100, 400, 10_000])
@pytest.mark.parametrize(
    ("correlation", "rates"),
    [
        (0.0, (0.01, 0.03, 0.1, 0.3, 0.5)),
        (0.005, (0.01, 0.03, 0.1, 0.3, 0.5)),
        (0.02, (0.03, 0.1, 0.3, 0.5)),
        (0.1, (0.1, 0.3, 0.5)),
    ],
)
def test_seed_interval_covers_93_to_97_percent_on_the_whole_grid(
    correlation: float, rates: tuple[float, ...], episodes: int
) -> None:
    measured = {rate: coverage(rate, correlation, [episodes] * SEEDS, 4000, stream=1) for rate in rates}
    assert all(0.93 <= covered <= 0.97 for covered in measured.values()), measured


@pytest.mark.parametrize(
    ("rate", "correlation", "trials", "low", "high"),
    [
        (0.03, 0.1, [400] * SEEDS, 0.85, 0.92),
        (0.01, 0.1, [400] * SEEDS, 0.65, 0.76),
        (0.001, 0.02, [10_000] * SEEDS, 0.50, 0.62),
        (0.1, 0.02, [100, 250, 400, 550, 700], 0.90, 0.94),
    ],
)
def test_known_shortfall_rare_uneven_seeds_are_under_covered(
    rate: float, correlation: float, trials: list[int], low: float, high: float
) -> None:
    # Stated in the module docstring: five seeds often miss the bad one. A better method moves these bounds.
    assert low <= coverage(rate, correlation, trials, 1500) <= high


def test_known_excess_two_expected_events_are_over_covered() -> None:
    assert 0.965 <= coverage(0.001, 0.0, [400] * SEEDS) <= 0.99


def test_plain_percentile_bootstrap_under_covers_with_five_seeds() -> None:
    rng = np.random.default_rng(5)
    events = draw_events(rng, 0.1, 0.02, [400] * SEEDS, 800)
    rates = (percentile_seed_rate(row, [400] * SEEDS, rng, 500) for row in events)
    assert 0.78 <= np.mean([rate.interval.contains(0.1) for rate in rates]) <= 0.88


def test_pooled_clopper_pearson_under_covers_when_seeds_differ() -> None:
    events = draw_events(np.random.default_rng(6), 0.1, 0.02, [400] * SEEDS, 800).sum(axis=1)
    assert np.mean([exact_rate(int(k), 2000).interval.contains(0.1) for k in events]) < 0.6


def test_percentile_bootstrap_repeats_with_its_generator_and_spans_the_seeds() -> None:
    first, second = (percentile_seed_rate([1, 5, 9], [10, 10, 10], np.random.default_rng(3), 2000) for _ in range(2))
    assert first == second
    assert first.method is SeedInterval.PERCENTILE_BOOTSTRAP
    # All three draws hit the lowest seed with probability 1/27 = 3.7 % > 2.5 %: the bounds are the extremes.
    assert (first.interval.low, first.interval.high) == (0.1, 0.9)


@pytest.mark.parametrize(
    ("events", "trials", "message"),
    [
        ([1, -1], [5, 5], "events holds -1 at index 1"),
        ([1, 6], [5, 5], "seed index 1 has 6 events in 5 trials"),
        ([1.5], [5], r"events holds 1\.5"),
        ([math.nan], [5], "events holds nan"),
        ([1], [5, 5], "events has 1 seeds but trials has 2"),
        ([], [], "events is empty"),
        ([[1]], [[5]], r"events has shape \(1, 1\)"),
        (["a"], [5], "pass real numbers"),
    ],
)
def test_bad_seed_counts_are_refused_by_value(events: list, trials: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        seed_rate(events, trials)


def test_resampling_refuses_seeds_for_generators_and_too_few_resamples() -> None:
    with pytest.raises(ValueError, match="rng is 7"):
        percentile_seed_rate([1], [2], 7)
    with pytest.raises(ValueError, match="resamples is 10"):
        percentile_seed_rate([1], [2], np.random.default_rng(0), 10)


def test_without_an_event_more_seeds_on_the_same_list_do_not_tighten_the_bound():
    one, five = seed_rate([0], [1_000]), seed_rate([0] * 5, [1_000] * 5, independent=1_000)
    assert five.interval == one.interval
    assert five.rate == exact_rate(0, 5_000, independent=1_000)
    assert seed_rate([0] * 5, [1_000] * 5).interval.high < one.interval.high


def test_seeds_that_agree_by_luck_keep_the_width_of_the_distinct_episodes():
    shared = seed_rate([50, 50], [1_000, 1_000], independent=1_000).interval
    apart = seed_rate([50, 50], [1_000, 1_000]).interval
    assert apart.low > shared.low
    assert apart.high < shared.high


def test_a_zero_is_stated_with_its_one_sided_bound_and_events_with_their_interval():
    zero, some = seed_rate([0, 0], [500, 500], independent=500), seed_rate([3, 5], [500, 500])
    assert (zero.stated.low, zero.stated.high) == (0.0, pytest.approx(1.0 - 0.05 ** (1 / 500)))
    assert zero.stated.high < zero.interval.high
    assert some.stated == some.interval
    assert seed_rate([0], [0]).stated.empty
