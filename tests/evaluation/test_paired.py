"""Intervals and tests against formulas written out, enumeration, and simulated experiments with a known truth."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from scipy import stats

from sextant.errors import ArgumentError
from sextant.evaluation import mean_interval, paired_difference
from sextant.evaluation.paired import crossed_interval

SEEDS, REPLICATIONS = 8, 400


def two_arms(seed, *shape):
    return np.random.default_rng(seed).normal(size=(2, *shape))


def interval(result):
    return result.low, result.high


def coverage(interval_of, experiments):
    """How often the interval holds the true difference, which is 0."""
    return np.mean([low <= 0 <= high for low, high in map(interval_of, experiments)])


def crossed_experiments(seed_spread, image_spread, images=60):
    """Differences of 8 seeds on images that all seeds share."""
    rng = np.random.default_rng(2)
    by_seed = seed_spread * rng.normal(size=(REPLICATIONS, SEEDS, 1))
    by_image = image_spread * rng.normal(size=(REPLICATIONS, 1, images))
    return by_seed + by_image + rng.normal(size=(REPLICATIONS, SEEDS, images))


def signed_rank_p_value(differences):
    """Wilcoxon's test by going through every assignment of signs."""
    ranks = stats.rankdata(np.abs(differences))
    found = abs(np.sum(np.sign(differences) * ranks))
    return np.mean([abs(np.dot(signs, ranks)) >= found for signs in product([-1, 1], repeat=len(ranks))])


@given(st.integers(0, 999), st.integers(2, 12), st.sampled_from([0.8, 0.95, 0.99]))
def test_the_interval_is_that_of_the_paired_t_test(seed, pairs, confidence):
    treatment, control = two_arms(seed, pairs)
    result = paired_difference(treatment, control, confidence=confidence)
    differences = treatment - control
    half = stats.t.ppf((1 + confidence) / 2, pairs - 1) * differences.std(ddof=1) / np.sqrt(pairs)
    assert interval(result) == pytest.approx((differences.mean() - half, differences.mean() + half))
    assert (result.mean, result.spread) == pytest.approx((differences.mean(), differences.std(ddof=1)))
    assert (result.seeds, result.wins) == (pairs, np.sum(treatment > control))
    assert interval(result) == pytest.approx(mean_interval(differences, confidence))


@given(st.integers(0, 999), st.integers(2, 8))
def test_the_p_value_is_that_of_all_assignments_of_signs(seed, pairs):
    treatment, control = two_arms(seed, pairs)
    assert paired_difference(treatment, control).p_value == pytest.approx(signed_rank_p_value(treatment - control))


@given(st.integers(0, 999), st.integers(2, 8))
def test_swapping_the_arms_turns_the_sign(seed, pairs):
    treatment, control = two_arms(seed, pairs)
    result = paired_difference(treatment, control)
    swapped = paired_difference(control, treatment)
    turned = (-result.mean, -result.high, -result.low)
    assert (swapped.mean, swapped.low, swapped.high) == pytest.approx(turned, nan_ok=True)
    assert (swapped.p_value, swapped.wins) == (result.p_value, pairs - result.wins)
    lower = paired_difference(treatment, control, better="lower")
    assert (lower.mean, lower.wins) == (result.mean, swapped.wins)


@given(st.integers(0, 999), st.integers(2, 8), st.integers(2, 30))
def test_images_of_a_seed_count_through_their_mean(seed, pairs, images):
    treatment, control = two_arms(seed, pairs, images)
    nested = paired_difference(treatment, control)
    means = paired_difference(treatment.mean(1), control.mean(1))
    assert (nested.mean, *interval(nested), nested.p_value) == pytest.approx(
        (means.mean, *interval(means), means.p_value)
    )
    assert np.isnan([means.image_low, means.image_high]).all()


@pytest.mark.slow
def test_the_t_interval_covers_the_truth_as_often_as_it_says():
    experiments = np.random.default_rng(1).normal(size=(REPLICATIONS, SEEDS, 1))
    covered = coverage(lambda d: interval(paired_difference(d, np.zeros_like(d))), experiments)
    assert 0.92 <= covered <= 0.98


@pytest.mark.parametrize(("seed_spread", "image_spread"), [(1.0, 0.0), (1.0, 3.0)])
def test_the_crossed_interval_covers_the_truth_of_all_seeds_and_images(seed_spread, image_spread):
    assert 0.92 <= coverage(crossed_interval, crossed_experiments(seed_spread, image_spread)) <= 0.99


def test_only_the_crossed_interval_counts_the_images_as_a_sample():
    experiments = crossed_experiments(seed_spread=0.2, image_spread=3.0)
    assert coverage(lambda d: mean_interval(d.mean(1)), experiments) < 0.8
    assert coverage(crossed_interval, experiments) >= 0.93


@given(st.integers(0, 999), st.integers(2, 8), st.integers(2, 30))
def test_the_crossed_interval_is_at_least_as_wide_as_that_of_the_seeds(seed, pairs, images):
    result = paired_difference(*two_arms(seed, pairs, images))
    assert result.image_low <= result.low + 1e-12
    assert result.image_high >= result.high - 1e-12


def test_the_crossed_variance_is_the_two_way_analysis_of_variance_by_hand():
    differences = np.array([[1.0, 5.0, 3.0], [2.0, 9.0, 1.0]])
    # seed means 3, 4; image means 1.5, 7, 2; residuals ±(0, -1.5, 1.5), so MSE = 9 / 2
    variance = 0.5 / 2 + (2**2 + 3.5**2 + 1.5**2) / 2 / 3 - 4.5 / 6
    half = stats.t.ppf(0.975, 1) * np.sqrt(variance)
    assert crossed_interval(differences) == pytest.approx((3.5 - half, 3.5 + half))


def test_equal_arms_differ_by_nothing():
    arm = two_arms(0, SEEDS)[0]
    result = paired_difference(arm, arm)
    assert (result.mean, result.low, result.high, result.p_value, result.wins) == (0, 0, 0, 1, 0)


def test_a_constant_difference_has_an_interval_of_no_width():
    control = np.arange(8.0)
    result = paired_difference(control + 2, control)
    assert (*interval(result), result.spread, result.wins) == (2, 2, 0, 8)
    assert result.p_value == 2 / 2**8


@pytest.mark.parametrize("pairs", [8, 11, 12, 13])
def test_pairs_that_are_all_alike_have_no_spread(pairs):
    result = paired_difference(np.full(pairs, 100.0), np.full(pairs, 36.3))
    assert result.spread == 0
    assert interval(result) == pytest.approx((result.mean, result.mean), abs=1e-12)


def test_one_pair_has_a_mean_and_no_interval():
    result = paired_difference(np.array([0.9]), np.array([0.7]))
    assert result.mean == pytest.approx(0.2)
    assert np.isnan([result.spread, result.low, result.high, result.image_low, result.image_high, result.p_value]).all()


@pytest.mark.parametrize("shapes", [((8,), (7,)), ((8, 5), (8, 6)), ((0,), (0,))])
def test_arms_that_are_not_pairs_are_refused(shapes):
    treatment, control = map(np.zeros, shapes)
    with pytest.raises((ValueError, TypeCheckError), match=r"need the same pairs|Type-check error"):
        paired_difference(treatment, control)


@pytest.mark.parametrize("interval_of", [mean_interval, lambda v: crossed_interval(v[:, None])])
def test_fewer_than_two_values_have_no_interval(interval_of):
    assert np.isnan(interval_of(np.array([0.5]))).all()


@pytest.mark.slow
@given(st.integers(0, 999))
def test_intervals_are_cut_at_the_largest_difference(seed):
    right = np.random.default_rng(seed).random((2, 6, 20)) < np.array([0.99, 0.02])[:, None, None]
    treatment, control = 100.0 * right
    free = paired_difference(treatment, control)
    cut = paired_difference(treatment, control, largest=100)
    other = paired_difference(control, treatment, largest=100)
    assert interval(cut) == (max(free.low, -100), min(free.high, 100))
    assert -100 <= other.low <= other.image_high <= 100
    assert cut.image_high <= 100
    assert (cut.mean, cut.p_value) == (free.mean, free.p_value)


def test_the_cut_leaves_a_missing_interval_missing():
    found = paired_difference(np.array([1.0]), np.array([0.0]), largest=100)
    assert np.isnan([found.low, found.high, found.image_low, found.image_high, found.t_p_value]).all()


@given(st.integers(0, 999), st.integers(2, 9))
def test_the_t_tests_p_belongs_to_the_interval(seed, pairs):
    treatment, control = two_arms(seed, pairs)
    result = paired_difference(treatment, control)
    assert result.t_p_value == pytest.approx(stats.ttest_rel(treatment, control).pvalue)
    assert (result.t_p_value < 0.05) == (not result.low <= 0 <= result.high)


def test_what_differs_but_for_rounding_is_equal():
    same = paired_difference(np.full(8, 0.1 + 0.2), np.full(8, 0.3))
    assert (same.mean, same.spread, same.wins, same.p_value, same.t_p_value) == (0, 0, 0, 1, 1)
    assert interval(same) == pytest.approx((0, 0))
    rounded = paired_difference(np.array([0.3, 0.1 + 0.2] * 4), np.full(8, 0.3))
    assert (rounded.mean, rounded.spread, rounded.wins, rounded.p_value, rounded.t_p_value) == (0, 0, 0, 1, 1)


def test_ranks_that_are_tied_but_for_rounding_are_tied():
    control = np.array([0.0, 0.2, 0.4, 0.0, 0.7])
    treatment = control + np.array([0.1, 0.1, -0.1, 0.3, 0.1])
    exact = paired_difference(np.array([1, 1, -1, 3, 1]), np.zeros(5))
    assert paired_difference(treatment, control).p_value == exact.p_value


def test_an_unknown_direction_is_refused():
    with pytest.raises((ArgumentError, TypeCheckError), match=r"better='foo' must be one of|Type-check error"):
        paired_difference(np.arange(4.0), np.zeros(4), better="foo")
