"""Paired comparison on the held-out list: McNemar, Holm, mean differences."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bench.statistics import (
    PairedScores,
    bootstrap_scenario_difference,
    holm,
    mcnemar_exact,
    paired_mean_difference,
)

FLAGS = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60)


def paired(first, second) -> PairedScores:
    ids = [f"a-{index}" for index in range(np.shape(first)[1])]
    return PairedScores(ids, first, list(ids), second)


def flags(only_first: int, only_second: int, both: int = 0, neither: int = 0) -> PairedScores:
    first = [1] * only_first + [0] * only_second + [1] * both + [0] * neither
    second = [0] * only_first + [1] * only_second + [1] * both + [0] * neither
    return paired([first], [second])


def test_mcnemar_by_hand() -> None:
    # Six discordant pairs, one against five: 2 (C(6,0) + C(6,1)) / 2^6 = 14/64.
    result = mcnemar_exact(flags(only_first=1, only_second=5, both=2, neither=10))
    assert (result.both, result.only_first, result.only_second, result.neither) == (2, 1, 5, 10)
    assert result.p_value == pytest.approx(14 / 64)


@pytest.mark.parametrize(("only_first", "only_second", "p"), [(0, 0, 1.0), (3, 3, 1.0), (0, 5, 2 / 32), (1, 0, 1)])
def test_mcnemar_edges_by_hand(only_first: int, only_second: int, p: float) -> None:
    assert mcnemar_exact(flags(only_first, only_second, neither=1)).p_value == pytest.approx(p)


@given(FLAGS, st.randoms(use_true_random=False))
def test_mcnemar_is_symmetric_and_blind_to_order(pairs: list[tuple[bool, bool]], shuffler) -> None:
    first, second = zip(*pairs, strict=True)
    forward, backward = mcnemar_exact(paired([first], [second])), mcnemar_exact(paired([second], [first]))
    assert forward.p_value == backward.p_value
    assert forward.only_first == backward.only_second
    shuffler.shuffle(pairs)
    first, second = zip(*pairs, strict=True)
    assert mcnemar_exact(paired([first], [second])) == forward


@given(FLAGS)
def test_mcnemar_equals_a_binomial_test_of_the_discordant_pairs(pairs: list[tuple[bool, bool]]) -> None:
    first, second = zip(*pairs, strict=True)
    result = mcnemar_exact(paired([first], [second]))
    discordant = result.only_first + result.only_second
    assert result.both + result.neither + discordant == len(pairs)
    expected = stats.binomtest(result.only_first, discordant).pvalue if discordant else 1.0
    assert result.p_value == pytest.approx(expected, abs=1e-12)


def test_mcnemar_pairs_seed_by_seed() -> None:
    result = mcnemar_exact(paired([[1, 0], [0, 0]], [[0, 0], [1, 1]]))
    assert (result.only_first, result.only_second, result.neither) == (1, 2, 1)


def test_holm_by_hand() -> None:
    # Sorted 0.01, 0.02, 0.03, 0.6 times 4, 3, 2, 1: 0.04, 0.06, 0.06, 0.6 (0.06 is already monotone).
    assert holm([0.6, 0.01, 0.03, 0.02]) == pytest.approx([0.6, 0.04, 0.06, 0.06])
    assert holm([0.5, 0.9]).tolist() == [1.0, 1.0]


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6))
def test_holm_is_the_closed_test_of_bonferroni(p_values: list[float]) -> None:
    # A hypothesis falls only if every set that holds it falls: the largest |S| min(S) over those sets.
    tests = range(len(p_values))
    sets = [chosen for size in tests for chosen in itertools.combinations(tests, size + 1)]
    expected = [
        max(min(1.0, len(chosen) * min(p_values[i] for i in chosen)) for chosen in sets if test in chosen)
        for test in tests
    ]
    assert holm(p_values) == pytest.approx(expected)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_holm_never_lowers_a_p_value_and_keeps_their_order(p_values: list[float]) -> None:
    adjusted = holm(p_values)
    assert np.all(adjusted >= np.array(p_values))
    assert np.all(np.diff(adjusted[np.argsort(p_values)]) >= 0.0)


def test_mean_difference_over_seeds_by_hand() -> None:
    # Seed differences 1, 2, 3: mean 2, error 1 / sqrt(3), t(2) = 4.3027.
    estimate = paired_mean_difference(paired([[2, 4], [3, 5], [4, 6]], [[1, 3], [2, 2], [2, 2]]))
    half = 4.302652729911275 / math.sqrt(3)
    assert estimate.value == 2.0
    assert estimate.replicates == 3
    assert (estimate.interval.low, estimate.interval.high) == pytest.approx((2 - half, 2 + half))


@given(st.integers(0, 2**32), st.integers(2, 6), st.integers(1, 9))
def test_mean_difference_is_antisymmetric_and_blind_to_seed_order(entropy: int, seeds: int, scenarios: int) -> None:
    first, second = np.random.default_rng(entropy).normal(size=(2, seeds, scenarios))
    estimate = paired_mean_difference(paired(first, second))
    reverse = paired_mean_difference(paired(second[::-1], first[::-1]))
    assert estimate.interval.contains(estimate.value)
    assert reverse.value == pytest.approx(-estimate.value)
    assert reverse.interval.low == pytest.approx(-estimate.interval.high)


def test_one_seed_has_no_interval_over_seeds_but_one_over_scenarios() -> None:
    pairs = paired([[1.0, 2.0, 4.0]], [[0.0, 0.0, 0.0]])
    assert paired_mean_difference(pairs).interval.empty
    over_scenarios = bootstrap_scenario_difference(pairs, np.random.default_rng(0))
    # All three draws hit the lowest difference with probability 1/27 > 2.5 %: the bounds are the extremes.
    assert (over_scenarios.interval.low, over_scenarios.interval.high) == (1.0, 4.0)
    assert over_scenarios.replicates == 3


def test_scenario_bootstrap_draws_scenarios_whole_and_repeats_with_its_generator() -> None:
    # Two seeds that cancel in each scenario: no draw of whole scenarios moves the mean.
    pairs = paired([[1.0, 9.0], [-1.0, -9.0]], [[0.0, 0.0], [0.0, 0.0]])
    assert bootstrap_scenario_difference(pairs, np.random.default_rng(0)).interval.width == 0.0
    noisy = paired(np.random.default_rng(1).normal(size=(3, 40)), np.zeros((3, 40)))
    first, second = (bootstrap_scenario_difference(noisy, np.random.default_rng(4)) for _ in range(2))
    assert first == second
    assert bootstrap_scenario_difference(paired([[1]], [[0]]), np.random.default_rng(0)).interval.empty


def two_trainings(rng: np.random.Generator) -> PairedScores:
    """Two methods of equal mean whose five seeds differ by luck."""
    luck, noise = rng.standard_normal((2, 5, 1)), rng.standard_normal((2, 5, 60))
    return paired(*(0.5 * luck + noise))


def test_seed_interval_covers_93_to_97_percent() -> None:
    rng = np.random.default_rng(21)
    estimates = (paired_mean_difference(two_trainings(rng)) for _ in range(3000))
    assert 0.93 <= np.mean([estimate.interval.contains(0.0) for estimate in estimates]) <= 0.97


def test_scenario_bootstrap_does_not_speak_for_new_seeds() -> None:
    rng = np.random.default_rng(22)
    estimates = (bootstrap_scenario_difference(two_trainings(rng), rng, 100) for _ in range(200))
    assert np.mean([estimate.interval.contains(0.0) for estimate in estimates]) < 0.7


def test_seed_interval_equals_scipys_one_sample_t() -> None:
    first = np.random.default_rng(3).normal(size=(5, 7))
    reference = stats.ttest_1samp(first.mean(axis=1), 0.0).confidence_interval(0.95)
    interval = paired_mean_difference(paired(first, np.zeros((5, 7)))).interval
    assert (interval.low, interval.high) == pytest.approx((reference.low, reference.high))


@pytest.mark.parametrize(
    ("first_ids", "second_ids", "message"),
    [
        (["a-1", "a-2"], ["a-1", "a-3"], "differ at place 1: 'a-2' in first, 'a-3' in second"),
        (["a-1", "a-2"], ["a-2", "a-1"], "differ at place 0: 'a-1' in first, 'a-2' in second"),
        (["a-1", "a-2"], ["a-1"], "'a-2' is missing from second"),
        (["a-1"], ["a-1", "a-2"], "'a-2' is missing from first"),
        (["a-1", "a-1"], ["a-1", "a-1"], "'a-1' is repeated"),
    ],
)
def test_unequal_scenario_lists_are_refused_by_name(first_ids: list, second_ids: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PairedScores(first_ids, np.zeros((1, len(first_ids))), second_ids, np.zeros((1, len(second_ids))))


def test_values_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"second has shape \(1, 1\) for 2 scenario ids"):
        PairedScores(["x", "y"], [[0, 1]], ["x", "y"], [[0]])
    for compare in (mcnemar_exact, paired_mean_difference):
        with pytest.raises(ValueError, match=r"first has shape \(1, 2\) but second has \(2, 2\)"):
            compare(paired([[0, 1]], [[0, 1], [0, 1]]))
    with pytest.raises(ValueError, match="first holds 2 at flat index 1: pass 0 or 1"):
        mcnemar_exact(paired([[0, 2]], [[0, 1]]))
    with pytest.raises(ValueError, match=r"p_values holds 1\.5 at index 1"):
        holm([0.5, 1.5])
    with pytest.raises(ValueError, match="p_values is empty"):
        holm([])
