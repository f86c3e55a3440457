"""The interval of mean shares against its definition, and how often it holds the truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from sextant.evaluation import mean_interval, share_interval, share_interval_of

REPLICATIONS = 1000


@given(arrays(float, st.integers(2, 12), elements=st.integers(0, 8).map(lambda count: count / 8)))
def test_it_holds_the_mean_and_stays_in_range(values):
    low, high = share_interval(values, trials=8 * len(values))
    assert 0 <= low <= values.mean() <= high <= 1
    assert low < high


def test_it_is_clopper_and_pearsons_at_the_effective_number_of_trials():
    values = np.array([0.9, 0.95, 1.0, 0.85])
    mean, error = values.mean(), stats.sem(values)
    trials = mean * (1 - mean) / error**2 * (stats.norm.ppf(0.95) / stats.t.ppf(0.95, 3)) ** 2
    low = stats.beta.ppf(0.05, trials * mean, trials * (1 - mean) + 1)
    high = stats.beta.ppf(0.95, trials * mean + 1, trials * (1 - mean))
    assert share_interval(values, confidence=0.9) == pytest.approx((low, high))
    assert share_interval_of(mean, values.std(ddof=1), 4, confidence=0.9) == pytest.approx((low, high))


def test_far_from_the_ends_it_is_the_t_interval():
    values = 0.5 + 0.001 * np.random.default_rng(0).standard_normal(10)
    assert share_interval(values) == pytest.approx(mean_interval(values), rel=1e-4)


def test_one_failure_of_eighty_stays_in_range_where_the_t_interval_does_not():
    values = np.array([1.0] * 9 + [0.875])
    assert mean_interval(values)[1] == pytest.approx(1.016, abs=1e-3)  # 98.8 [95.9, 101.6] per cent
    assert share_interval(values) == pytest.approx((0.917, 1.0), abs=1e-3)


def test_seeds_that_agree_count_as_their_trials_or_tell_nothing():
    assert np.isnan(share_interval(np.ones(10))).all()
    assert share_interval(np.ones(10), trials=80) == pytest.approx((0.940, 1.0), abs=1e-3)
    low, high = share_interval(np.zeros(10), trials=80)
    assert (low, high) == pytest.approx((0.0, 1 - 0.940), abs=1e-3)
    assert np.isnan(share_interval(np.array([0.5]), trials=8)).all()
    assert np.isnan(share_interval_of(float("nan"), 0.1, 5)).all()


def test_per_cent_are_refused():
    with pytest.raises(ValueError, match=r"shares must be in \[0, 1\], got 90.0 to 100.0"):
        share_interval(np.array([90.0, 100.0]))


def holds(interval_of, shares, truth):
    return np.mean([low <= truth <= high for low, high in map(interval_of, shares)])


@pytest.mark.slow
@pytest.mark.parametrize(("seeds", "trials"), [(5, 8), (8, 1000), (10, 64)])
@pytest.mark.parametrize("truth", [0.5, 0.99])
@pytest.mark.parametrize("correlation", [0.0, 0.01])
def test_it_holds_the_mean_at_least_as_often_as_it_says(seeds, trials, truth, correlation):
    """Seeds whose probability of success differs (beta), each with so many trials."""
    rng = np.random.default_rng([seeds, trials, int(1000 * truth), int(100 * correlation)])
    probability = np.full((REPLICATIONS, seeds), truth)
    if correlation:
        scale = 1 / correlation - 1
        probability = rng.beta(truth * scale, (1 - truth) * scale, probability.shape)
    shares = rng.binomial(trials, probability) / trials
    found = holds(lambda values: share_interval(values, seeds * trials), shares, truth)
    assert found > 0.95 - 3 * np.sqrt(0.95 * 0.05 / REPLICATIONS)  # 0.93: what chance leaves of 0.95
    assert found > holds(mean_interval, shares, truth) - 0.01


@pytest.mark.slow
def test_t_intervals_of_few_rare_failures_do_not():
    shares = np.random.default_rng(0).binomial(8, 0.99, (REPLICATIONS, 10)) / 8
    assert holds(mean_interval, shares, 0.99) == pytest.approx(0.55, abs=0.04)
    assert holds(lambda values: share_interval(values, 80), shares, 0.99) > 0.97
