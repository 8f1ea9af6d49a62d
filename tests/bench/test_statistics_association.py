"""What a risk score is worth: Spearman, area under the ROC curve, reliability bins."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from bench.statistics import (
    area_under_curve,
    area_under_curve_interval,
    exact_rate,
    reliability,
    spearman,
    spearman_interval,
)

# Few distinct values, so that ties occur.
SAMPLES = st.integers(2, 25).flatmap(lambda size: arrays(np.float64, (2, size), elements=st.integers(0, 6)))
FORECASTS = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 1)), min_size=1, max_size=60)


def test_spearman_by_hand() -> None:
    # Ranks 1 2 3 4 against 2 1 4 3: 1 - 6 (1 + 1 + 1 + 1) / (4 (16 - 1)) = 0.6.
    assert spearman([1, 2, 3, 4], [20, 10, 40, 30]) == pytest.approx(0.6)
    # Ties at mid-ranks: 1.5 1.5 3 against 1 2 3, covariance 1.5 over sqrt(1.5 x 2).
    assert spearman([5, 5, 9], [1, 2, 3]) == pytest.approx(1.5 / math.sqrt(3.0))
    assert spearman([1, 2, 3], [9, 5, 1]) == pytest.approx(-1.0)


@given(SAMPLES)
def test_spearman_equals_scipys(samples: np.ndarray) -> None:
    first, second = samples
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        assert math.isnan(spearman(first, second))
    else:
        assert spearman(first, second) == pytest.approx(stats.spearmanr(first, second).statistic, abs=1e-9)


@given(SAMPLES, st.randoms(use_true_random=False))
def test_spearman_is_symmetric_and_blind_to_order_and_scale(samples: np.ndarray, shuffler) -> None:
    order = list(range(samples.shape[1]))
    shuffler.shuffle(order)
    first, second = samples
    value = spearman(first, second)
    assert spearman(second[order], np.exp(first[order])) == pytest.approx(value, abs=1e-9, nan_ok=True)


def test_a_constant_risk_has_no_correlation_and_no_interval() -> None:
    estimate = spearman_interval([2.0] * 10, range(10), np.random.default_rng(0))
    assert math.isnan(estimate.value)
    assert estimate.interval.empty


def test_a_perfect_correlation_has_zero_width() -> None:
    estimate = spearman_interval(range(10), range(10), np.random.default_rng(0))
    assert (estimate.value, estimate.interval.low, estimate.interval.high) == (1.0, 1.0, 1.0)


@given(SAMPLES, st.integers(0, 99))
def test_spearman_interval_contains_the_point_within_its_range(samples: np.ndarray, entropy: int) -> None:
    estimate = spearman_interval(*samples, np.random.default_rng(entropy), resamples=100)
    if not estimate.interval.empty:
        assert -1.0 <= estimate.interval.low <= estimate.value <= estimate.interval.high <= 1.0


def test_spearman_bootstrap_equals_ranking_each_resample_anew() -> None:
    # The correction by hand: bootstrap error x sqrt(n / (n - 1)) x t, over 1 - rho^2 on Fisher's z scale.
    first, second = np.random.default_rng(1).normal(size=(2, 12))
    second = first + second
    draw = np.random.default_rng(2)
    resampled = []
    for _ in range(200):
        picked = draw.integers(0, 12, size=12)
        resampled.append(stats.spearmanr(first[picked], second[picked]).statistic)
    value = spearman(first, second)
    half = stats.t.ppf(0.975, 11) * np.std(resampled, ddof=1) * math.sqrt(12 / 11) / (1 - value**2)
    interval = spearman_interval(first, second, np.random.default_rng(2), resamples=200).interval
    expected = np.tanh([np.arctanh(value) - half, np.arctanh(value) + half])
    assert (interval.low, interval.high) == pytest.approx(tuple(expected))


def test_samples_of_one_episode_count_once() -> None:
    # Ten copies of each sample: as groups they tell what the ten originals tell, singly they look like 100.
    first, second = np.random.default_rng(5).normal(size=(2, 10))
    second = first + second
    copies = (np.repeat(first, 10), np.repeat(second, 10))
    plain = spearman_interval(first, second, np.random.default_rng(0))
    grouped = spearman_interval(*copies, np.random.default_rng(0), groups=np.repeat(np.arange(10), 10))
    single = spearman_interval(*copies, np.random.default_rng(0))
    assert grouped.interval.low == pytest.approx(plain.interval.low)
    assert grouped.replicates == plain.replicates == 10
    assert single.interval.width < 0.5 * grouped.interval.width


@pytest.mark.slow
@pytest.mark.parametrize(("groups", "low", "high"), [(5, 0.95, 0.995), (20, 0.93, 0.97)])
def test_spearman_interval_covers(groups: int, low: float, high: float) -> None:
    # Bivariate normal with correlation 0.5: rho_s = 6/pi asin(0.25). Five groups: conservative.
    truth, samples = 6.0 / math.pi * math.asin(0.25), 200 // groups
    members, rng, covered = np.repeat(np.arange(groups), samples), np.random.default_rng(31), 0
    for _ in range(1000):
        common, own = rng.standard_normal((2, groups)), rng.standard_normal((2, groups * samples))
        first, noise = math.sqrt(0.5) * (common[:, members] + own)
        second = 0.5 * first + math.sqrt(0.75) * noise
        covered += spearman_interval(first, second, rng, members, 100).interval.contains(truth)
    assert low <= covered / 1000 <= high


def test_area_under_curve_by_hand() -> None:
    # Events score 3 and 2, others 1, 2, 2: pairs 3 > all (3); 2 > 1, 2 = 2, 2 = 2 (1 + 1/2 + 1/2): 5 of 6.
    assert area_under_curve([3, 2, 1, 2, 2], [1, 1, 0, 0, 0]) == pytest.approx(5 / 6)
    assert area_under_curve([1, 2], [1, 0]) == 0.0


@given(SAMPLES)
def test_area_under_curve_equals_mann_whitney(samples: np.ndarray) -> None:
    scores, outcomes = samples[0], (samples[1] > 3).astype(float)
    value = area_under_curve(scores, outcomes)
    if outcomes.min() == outcomes.max():
        assert math.isnan(value)
    else:
        reference = stats.mannwhitneyu(scores[outcomes == 1], scores[outcomes == 0]).statistic
        assert value == pytest.approx(reference / (outcomes.sum() * (1 - outcomes).sum()))
        assert area_under_curve(-scores, outcomes) == pytest.approx(1.0 - value)


@given(SAMPLES, st.integers(0, 99))
def test_area_interval_contains_the_point_within_0_and_1(samples: np.ndarray, entropy: int) -> None:
    outcomes = (samples[1] > 3).astype(float)
    estimate = area_under_curve_interval(samples[0], outcomes, np.random.default_rng(entropy), resamples=100)
    if not estimate.interval.empty:
        assert 0.0 <= estimate.interval.low <= estimate.value <= estimate.interval.high <= 1.0


def test_a_perfect_order_of_three_events_shows_no_more_than_three_pairs_do() -> None:
    estimate = area_under_curve_interval(range(13), [0] * 10 + [1] * 3, np.random.default_rng(0))
    assert estimate.value == 1.0
    assert estimate.interval.low == pytest.approx(exact_rate(3, 3).low)


def test_no_event_gives_no_area_and_no_interval() -> None:
    estimate = area_under_curve_interval([1.0, 2.0], [0, 0], np.random.default_rng(0))
    assert math.isnan(estimate.value)
    assert estimate.interval.empty


@pytest.mark.slow
def test_area_interval_covers_93_to_97_percent_with_twenty_groups() -> None:
    truth, members = stats.norm.cdf(1.0 / math.sqrt(2.0)), np.repeat(np.arange(20), 10)
    rng, covered = np.random.default_rng(32), 0
    for _ in range(2000):
        outcomes = (rng.random(200) < 0.3).astype(float)
        noise = rng.standard_normal(20)[members] + rng.standard_normal(200)
        scores = outcomes + math.sqrt(0.5) * noise
        covered += area_under_curve_interval(scores, outcomes, rng, members, 100).interval.contains(truth)
    assert 0.93 <= covered / 2000 <= 0.97


def test_reliability_by_hand() -> None:
    # Bin [0, 0.5): 0.1, 0.3 (mean 0.2), one event of two.
    # Bin [0.5, 1]: 0.5, 1.0, 0.9 (mean 0.8), two events of three.
    # Error: 2/5 |0.5 - 0.2| + 3/5 |2/3 - 0.8| = 0.12 + 0.08.
    result = reliability([0.1, 0.3, 0.5, 1.0, 0.9], [0, 1, 0, 1, 1], bins=2)
    low, high = result.bins
    assert (low.samples, low.events, low.observed) == (2, 1, 0.5)
    assert (low.low, low.high, high.low, high.high) == (0.0, 0.5, 0.5, 1.0)
    assert low.mean_predicted == pytest.approx(0.2)
    assert (high.samples, high.events) == (3, 2)
    assert high.interval == exact_rate(2, 3).interval
    assert result.expected_calibration_error == pytest.approx(0.2)


@given(FORECASTS, st.integers(1, 15), st.randoms(use_true_random=False))
def test_reliability_counts_every_sample_once_in_any_order(pairs: list[tuple[float, int]], bins: int, shuffler) -> None:
    result = reliability(*zip(*pairs, strict=True), bins=bins)
    assert sum(row.samples for row in result.bins) == len(pairs)
    assert sum(row.events for row in result.bins) == sum(outcome for _, outcome in pairs)
    assert all(row.low - 1e-12 <= row.mean_predicted <= row.high + 1e-12 for row in result.bins)
    assert 0.0 <= result.expected_calibration_error <= 1.0
    shuffler.shuffle(pairs)
    again = reliability(*zip(*pairs, strict=True), bins=bins)
    assert again.expected_calibration_error == pytest.approx(result.expected_calibration_error, abs=1e-12)


def test_a_perfect_forecast_has_no_calibration_error_and_a_reversed_one_the_most() -> None:
    assert reliability([0.0, 1.0, 1.0], [0, 1, 1]).expected_calibration_error == 0.0
    assert reliability([1.0, 0.0, 0.0], [0, 1, 1]).expected_calibration_error == 1.0


def test_bad_samples_are_refused_by_value() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"first has shape \(2,\) but second has \(3,\)"):
        spearman([1, 2], [1, 2, 3])
    with pytest.raises(ValueError, match="first is empty"):
        spearman([], [])
    with pytest.raises(ValueError, match="groups has 1 entries for 2 samples"):
        spearman_interval([1, 2], [1, 2], rng, groups=[0])
    with pytest.raises(ValueError, match="rng is 3"):
        spearman_interval([1, 2], [1, 2], 3)
    with pytest.raises(ValueError, match=r"outcomes holds 0\.5 at flat index 1"):
        area_under_curve([1, 2], [0, 0.5])
    with pytest.raises(ValueError, match="scores holds nan at flat index 0"):
        area_under_curve([math.nan, 2], [0, 1])
    with pytest.raises(ValueError, match=r"predicted holds 1\.2 at index 1: pass probabilities"):
        reliability([0.1, 1.2], [0, 1])
    with pytest.raises(ValueError, match="bins is 0"):
        reliability([0.1], [0], bins=0)
