"""Differences over strata against Welch's test, and how often their intervals hold the truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from sextant.evaluation import Sample, stratified_difference


def samples(rng, *sizes):
    return [rng.normal(rng.normal(), rng.uniform(0.5, 3), size) for size in sizes]


@given(st.integers(0, 999), st.integers(2, 9), st.integers(2, 9))
def test_of_one_stratum_it_is_welchs_test(seed, runs, others):
    treatment, control = samples(np.random.default_rng(seed), runs, others)
    found = stratified_difference([(Sample.of(treatment), Sample.of(control))], confidence=0.9)
    expected = stats.ttest_ind(treatment, control, equal_var=False)
    ends = expected.confidence_interval(0.9)
    assert found.mean == pytest.approx(treatment.mean() - control.mean())
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high))
    assert (found.p_value, found.freedom) == pytest.approx((expected.pvalue, expected.df))


def test_strata_count_the_same_whatever_they_hold():
    pairs = [(Sample(2, 10.0, 1.0), Sample(50, 4.0, 1.0)), (Sample(9, 1.0, 0.1), Sample(9, 1.0, 0.1))]
    found = stratified_difference(pairs)
    assert found.mean == pytest.approx(3.0)
    error = np.sqrt((1 / 2 + 1 / 50 + 2 * 0.01 / 9) / 4)
    assert found.high - found.low == pytest.approx(2 * stats.t.ppf(0.975, found.freedom) * error)
    assert 1 < found.freedom < 2  # the two runs that scatter most decide


@given(st.integers(0, 999), st.integers(0, 5), st.integers(0, 5))
def test_joined_samples_are_the_sample_of_all(seed, runs, others):
    one, other = samples(np.random.default_rng(seed), runs, others)
    joined, whole = Sample.of(one).joined(Sample.of(other)), Sample.of(np.concatenate([one, other]))
    assert (joined.count, joined.mean, joined.spread) == pytest.approx(
        (whole.count, whole.mean, whole.spread), nan_ok=True
    )


def test_a_stratum_of_one_run_is_not_compared():
    assert stratified_difference([(Sample(1, 1.0, float("nan")), Sample(5, 0.0, 1.0))]) is None
    assert stratified_difference([]) is None


def test_the_interval_is_cut_at_the_largest_difference():
    pair = [(Sample(2, 90.0, 5.0), Sample(2, 5.0, 7.0))]
    free, cut = stratified_difference(pair), stratified_difference(pair, largest=100)
    assert free.high > 100
    assert (cut.low, cut.high, cut.p_value) == (free.low, 100, free.p_value)


def test_groups_without_spread_differ_or_do_not():
    same, more = Sample(3, 1.0, 0.0), Sample(3, 2.0, 0.0)
    assert stratified_difference([(same, same)]).p_value == 1
    found = stratified_difference([(more, same)])
    assert (found.mean, found.low, found.high, found.p_value) == (1, 1, 1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("runs", [3, 9])
def test_the_interval_holds_the_truth_as_often_as_it_says(runs):
    """Four networks of unequal spread, as many treated runs as given and twice as many controls."""
    rng = np.random.default_rng(runs)
    spreads, truth, replications = ((7, 9), (5, 15), (4, 7), (5, 10)), 6.0, 2000
    held, rejected = 0, 0
    for _ in range(replications):
        pairs = [(rng.normal(0, s, runs), rng.normal(0, c, 2 * runs)) for s, c in spreads]
        found = stratified_difference([(Sample.of(t + truth), Sample.of(c)) for t, c in pairs])
        held += found.low <= truth <= found.high
        rejected += stratified_difference([(Sample.of(t), Sample.of(c)) for t, c in pairs]).p_value < 0.05
    assert held / replications == pytest.approx(0.95, abs=0.015)
    assert rejected / replications == pytest.approx(0.05, abs=0.015)
