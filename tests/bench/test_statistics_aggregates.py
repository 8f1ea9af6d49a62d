"""Interquartile mean, performance profile, probability of improvement: by hand, against rliable, coverage."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rliable import metrics
from scipy import stats

from bench.statistics import (
    Resample,
    iqm,
    iqm_interval,
    performance_profile,
    probability_of_improvement,
    probability_of_improvement_interval,
)

SHAPES = st.tuples(st.integers(1, 6), st.integers(1, 8))
REALS = st.floats(-1e3, 1e3).map(lambda value: round(value, 3))
SCORES = SHAPES.flatmap(lambda shape: arrays(np.float64, shape, elements=REALS)).filter(
    lambda scores: bool(np.any((scores != 0) & (scores != 1)))
)
# Few distinct values, so that ties occur.
PAIRS = st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(1, 4)).flatmap(
    lambda size: st.tuples(
        arrays(np.float64, (size[0], size[2]), elements=st.integers(0, 5)),
        arrays(np.float64, (size[1], size[2]), elements=st.integers(0, 5)),
    )
)
SHORT_RESAMPLES = 300


def test_iqm_by_hand() -> None:
    # Of 1..8 two values go at each end: mean of 3, 4, 5, 6. Of seven values one goes: floor(7 / 4) = 1.
    assert iqm([[8, 1, 6, 3], [2, 7, 4, 5]]) == 4.5
    assert iqm([[1, 2, 3, 4, 5, 6, 700]]) == 4.0


def test_iqm_ignores_an_outlier_that_moves_the_mean() -> None:
    scores = np.array([[10.0, 11.0, 12.0, 13.0], [10.0, 11.0, 12.0, -900.0]])
    assert 10.0 <= iqm(scores) <= 12.0


@given(SCORES)
def test_iqm_equals_rliables(scores: np.ndarray) -> None:
    assert iqm(scores) == pytest.approx(metrics.aggregate_iqm(scores), rel=1e-9, abs=1e-9)


@given(SCORES, st.randoms(use_true_random=False))
def test_iqm_does_not_see_the_order_of_runs(scores: np.ndarray, shuffler) -> None:
    order = list(range(len(scores)))
    shuffler.shuffle(order)
    assert iqm(scores[order]) == iqm(scores)


@pytest.mark.parametrize("flags", [[[0, 1, 0]], [[True, False]], [[0.0, 0.0]], [[1, 1]]])
def test_iqm_refuses_event_flags(flags: list) -> None:
    for refused in (lambda: iqm(flags), lambda: iqm_interval(flags, np.random.default_rng(0))):
        with pytest.raises(ValueError, match="trims rare events away; use seed_rate"):
            refused()


def expected_interval(scores: np.ndarray, resampled: list[float], degrees: int) -> tuple[float, float]:
    seeds = len(scores)
    half = stats.t.ppf(0.975, degrees) * np.std(resampled, ddof=1) * math.sqrt(seeds / (seeds - 1))
    return iqm(scores) - half, iqm(scores) + half


@pytest.mark.parametrize("columns", [1, 3, 10])
def test_seed_bootstrap_equals_repeating_whole_rows(columns: int) -> None:
    scores = np.random.default_rng(1).normal(size=(5, columns))
    drawn = np.random.default_rng(2).multinomial(5, [0.2] * 5, size=SHORT_RESAMPLES)
    resampled = [iqm(np.repeat(scores, counts, axis=0)) for counts in drawn]
    interval = iqm_interval(scores, np.random.default_rng(2), resamples=SHORT_RESAMPLES).interval
    assert (interval.low, interval.high) == pytest.approx(expected_interval(scores, resampled, degrees=4))


def test_strata_bootstrap_draws_within_each_column() -> None:
    # Columns of equal values: a draw within columns changes nothing.
    scores = np.tile([1.0, 20.0, 300.0], (4, 1))
    interval = iqm_interval(scores, np.random.default_rng(0), Resample.STRATA, SHORT_RESAMPLES).interval
    assert interval.low == interval.high == iqm(scores)


def test_strata_bootstrap_has_columns_times_seeds_less_one_degrees_of_freedom() -> None:
    scores, draw = np.random.default_rng(1).normal(size=(3, 4)), np.random.default_rng(2)
    resampled = [
        iqm(np.take_along_axis(scores, draw.integers(0, 3, size=(3, 4)), axis=0)) for _ in range(SHORT_RESAMPLES)
    ]
    estimate = iqm_interval(scores, np.random.default_rng(2), Resample.STRATA, SHORT_RESAMPLES)
    expected = expected_interval(scores, resampled, degrees=8)
    assert (estimate.interval.low, estimate.interval.high) == pytest.approx(expected)


def test_iqm_interval_repeats_with_its_generator_and_ignores_the_global_one() -> None:
    scores = np.random.default_rng(1).normal(size=(5, 20))
    first = iqm_interval(scores, np.random.default_rng(9), resamples=SHORT_RESAMPLES)
    np.random.seed(0)
    assert iqm_interval(scores, np.random.default_rng(9), resamples=SHORT_RESAMPLES) == first


def test_one_seed_gives_a_value_without_an_interval() -> None:
    for resample in Resample:
        estimate = iqm_interval([[1.0, 2.0, 3.0]], np.random.default_rng(0), resample, SHORT_RESAMPLES)
        assert estimate.value == 2.0
        assert estimate.interval.empty
        assert estimate.replicates == 1


@given(SCORES.filter(lambda scores: len(scores) > 1), st.sampled_from(Resample))
def test_iqm_interval_contains_the_point_and_widens_with_level(scores: np.ndarray, resample: Resample) -> None:
    narrow, wide = (iqm_interval(scores, np.random.default_rng(0), resample, 100, level) for level in (0.8, 0.95))
    assert narrow.interval.contains(narrow.value)
    assert narrow.interval.width <= wide.interval.width


def iqm_coverage(seed_spread: float, step_spread: float, repetitions: int) -> float:
    """Share of intervals that hold 0, the interquartile mean of a symmetric population."""
    rng, covered = np.random.default_rng(11), 0
    for _ in range(repetitions):
        scores = seed_spread * rng.standard_normal((5, 1)) + step_spread * rng.standard_normal((5, 50))
        covered += iqm_interval(scores, rng, resamples=SHORT_RESAMPLES).interval.contains(0.0)
    return covered / repetitions


@pytest.mark.slow
@pytest.mark.parametrize(("seed_spread", "step_spread"), [(1.0, 1.0), (0.2, 1.0), (0.0, 1.0)])
def test_seed_bootstrap_of_the_iqm_covers_93_to_97_percent(seed_spread: float, step_spread: float) -> None:
    assert 0.93 <= iqm_coverage(seed_spread, step_spread, 2000) <= 0.97


@pytest.mark.slow
def test_strata_over_episodes_of_one_policy_under_cover() -> None:
    # Why SEEDS is the default: drawing episodes singly forgets that a seed shares one policy.
    rng, covered = np.random.default_rng(12), 0
    for _ in range(200):
        scores = rng.standard_normal((5, 1)) + rng.standard_normal((5, 50))
        covered += iqm_interval(scores, rng, Resample.STRATA, 200).interval.contains(0.0)
    assert covered / 200 < 0.6


def test_performance_profile_by_hand() -> None:
    profile = performance_profile([[1.0, 2.0], [2.0, 4.0]], [0.0, 1.0, 2.0, 4.0])
    assert profile.tolist() == [1.0, 0.75, 0.25, 0.0]


@given(SCORES, arrays(np.float64, 4, elements=REALS))
def test_performance_profile_is_the_share_above_and_falls(scores: np.ndarray, limits: np.ndarray) -> None:
    # rliable's run_score_deviation: mean(scores > tau). (Its module needs arch, which pandas 3 breaks.)
    limits = np.sort(limits)
    profile = performance_profile(scores, limits)
    assert profile == pytest.approx([np.mean(scores > limit) for limit in limits])
    assert np.all(np.diff(profile) <= 0.0)


def test_probability_of_improvement_by_hand() -> None:
    # Pairs: 1 > 2 no, 1 > 3 no, 3 > 2 yes, 3 = 3 half: 1.5 of 4.
    assert probability_of_improvement([[1], [3]], [[2], [3]]) == 0.375


@given(PAIRS)
def test_probability_of_improvement_equals_rliables(pair: tuple[np.ndarray, np.ndarray]) -> None:
    reference = metrics.probability_of_improvement(*pair)
    assert probability_of_improvement(*pair) == pytest.approx(reference, abs=1e-12)


@given(PAIRS)
def test_improvements_of_both_sides_add_up_to_one(pair: tuple[np.ndarray, np.ndarray]) -> None:
    first, second = pair
    total = probability_of_improvement(first, second) + probability_of_improvement(second, first)
    assert total == pytest.approx(1.0)


@given(PAIRS)
def test_improvement_interval_contains_the_point_within_0_and_1(pair: tuple[np.ndarray, np.ndarray]) -> None:
    estimate = probability_of_improvement_interval(*pair, np.random.default_rng(0), 100)
    if min(len(pair[0]), len(pair[1])) < 2:
        assert estimate.interval.empty
    else:
        assert 0.0 <= estimate.interval.low <= estimate.value <= estimate.interval.high <= 1.0


def test_five_seeds_that_all_win_show_no_more_than_five_disjoint_pairs_do() -> None:
    first, second = np.arange(10.0, 15.0)[:, None], np.arange(5.0)[:, None]
    estimate = probability_of_improvement_interval(first, second, np.random.default_rng(0))
    assert estimate.value == 1.0
    assert estimate.interval.low == pytest.approx(0.025 ** (1 / 5))
    assert estimate.interval.high == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "columns", "low", "high"), [(0.5, 50, 0.93, 0.97), (0.5, 1, 0.97, 1.0)])
def test_improvement_interval_covers(shift: float, columns: int, low: float, high: float) -> None:
    # One column and five seeds a side: the share moves in steps of 1/25, and the interval is conservative.
    spread = 0.3 if columns > 1 else 0.0
    truth = stats.norm.cdf(shift / math.sqrt(2.0 * (1.0 + spread**2)))
    rng, covered = np.random.default_rng(13), 0
    for _ in range(1000):
        first, second = (
            mean + spread * rng.standard_normal((5, 1)) + rng.standard_normal((5, columns)) for mean in (shift, 0.0)
        )
        estimate = probability_of_improvement_interval(first, second, rng, SHORT_RESAMPLES)
        covered += estimate.interval.contains(truth)
    assert low <= covered / 1000 <= high


@pytest.mark.parametrize(
    ("scores", "message"),
    [
        ([1.0, 2.0], r"scores has shape \(2,\): reshape it to 2 axes"),
        ([[]], "scores is empty"),
        ([[1.0, math.nan]], "scores holds nan at flat index 1"),
        ([[1.0, math.inf]], "scores holds inf"),
        ([["fast"]], "pass real numbers"),
    ],
)
def test_bad_scores_are_refused_by_value(scores: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        iqm(scores)


def test_unequal_columns_and_foreign_generators_are_refused() -> None:
    with pytest.raises(ValueError, match="first has 2 columns but second has 1"):
        probability_of_improvement([[1, 2]], [[1]])
    for resample in Resample:
        with pytest.raises(ValueError, match=r"pass numpy\.random\.default_rng"):
            iqm_interval([[1.0, 2.0]], np.random.RandomState(0), resample)
        with pytest.raises(ValueError, match="resamples is 5"):
            iqm_interval([[1.0, 2.0]], np.random.default_rng(0), resample, 5)
