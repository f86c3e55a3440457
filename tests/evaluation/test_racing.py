"""Which trials deserve another seed: what must hold of any scores, and what is saved in simulated searches."""

from functools import partial

import numpy as np
import pytest
from fuzzing import fuzz
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.racing import drawn, raced, search, simulated
from sextant.evaluation.racing import every, halving, leader, racing, seeds_run

NAN = np.nan


def test_nothing_is_out_before_anything_is_known_of_seeds():
    assert racing(np.array([[0.9, NAN, NAN], [0.1, NAN, NAN]])) == [0, 1]


def test_a_trial_alone_waits_for_another():
    assert racing(np.array([[0.9, NAN]])) == []
    assert racing(np.array([[0.9, NAN]]), last=True) == [0]
    assert leader(np.array([[0.9, NAN]])) == 0


def test_a_new_trial_gets_its_first_seed():
    assert racing(np.array([[0.9, 0.8], [NAN, NAN]])) == [1]
    assert racing(np.full((2, 3), NAN)) == [0, 1]


def test_one_seed_is_enough_for_a_trial_that_is_far_off():
    scores = np.array([[0.90, 0.92, 0.91, 0.90, 0.9], [0.89, 0.93, 0.90, 0.91, 0.9], [0.5, NAN, NAN, NAN, NAN]])
    assert racing(scores) == []
    scores[2, 0] = 0.89
    assert racing(scores) == [2]


def test_what_all_trials_share_at_a_seed_does_not_hide_a_difference():
    hard = np.array([0.0, -0.3, 0.2, -0.1, 0.1])
    scores = np.array([0.7 + hard, 0.69 + hard + [0, 0.001, 0, -0.001, 0], [0.65, 0.35, NAN, NAN, NAN]])
    assert racing(scores) == []


def test_a_run_without_a_result_ends_a_trial_and_is_never_the_best():
    scores = np.array([[0.9, -np.inf, NAN], [0.2, NAN, NAN], [0.3, NAN, NAN]])
    assert leader(scores) == 2
    assert 0 not in racing(scores)
    assert leader(np.array([[-np.inf, NAN]])) is None
    assert racing(np.array([[-np.inf, NAN]])) == every(np.array([[-np.inf, NAN]])) == []


def test_a_trial_comes_back_when_seeds_turn_out_to_make_more_than_was_thought():
    scores = np.full((4, 6), NAN)
    scores[0, :5], scores[1, :5], scores[2, :2] = 0.9, [0.899, 0.902, 0.9, 0.901, 0.9], [0.80, 0.81]
    scores[3, :4] = 0.9
    assert 2 not in racing(scores)
    scores[1, 4], scores[3, 3] = 0.5, 0.5
    assert 2 in racing(scores)


def test_two_equal_differences_of_accuracies_put_nothing_out():
    scores = np.array([[0.98, 0.97, NAN, NAN], [0.97, 0.96, NAN, NAN], [0.98, NAN, NAN, NAN]])
    assert racing(scores) == [0, 1, 2]


def test_halving_gives_more_seeds_to_ever_fewer():
    scores, told = np.full((8, 4), NAN), []
    values = np.arange(8)[:, None] * np.ones((8, 4))
    while deserving := halving(scores, 8):
        told.append(deserving)
        for trial in deserving:
            scores[trial, seeds_run(scores)[trial]] = values[trial, 0]
    assert told == [list(range(8)), [4, 5, 6, 7], [6, 7], [6, 7]]
    assert leader(scores) == 7


def test_halving_waits_for_all_trials():
    assert halving(np.array([[0.1, NAN], [0.2, NAN]]), 3) == []
    assert halving(np.array([[0.1, NAN], [0.2, NAN]]), 2) == [1]


@pytest.mark.slow
@fuzz
@given(st.integers(0, 2**31), st.integers(1, 10), st.integers(1, 5))
def test_whatever_the_scores(seed, trials, seeds):
    _, scores = drawn(seed, trials, seeds)
    random = np.random.default_rng(seed)
    scores[random.random(scores.shape) < 0.1] = -np.inf
    order = random.permutation(trials)
    for rule in (racing, every, partial(halving, trials=trials)):
        seen = raced(scores) if rule is racing else search(scores, rule)
        run = ~np.isnan(seen)
        assert run[:, 0].all()
        assert (np.diff(run.astype(int), axis=1) <= 0).all()  # in order, none left out
        assert (seen[run] == scores[run]).all()
        part = np.where(random.random((trials, 1)) < 0.5, seen, NAN)
        assert sorted(order[rule(part[order])]) == rule(part)  # where a trial stands does not matter
        if (best := leader(seen)) is not None:
            assert np.isfinite(seen[best]).all()  # the best has all seeds


@pytest.mark.slow
@pytest.mark.parametrize(("spread", "images"), [(0.005, None), (0.05, None), (0.01, 143)])
def test_racing_saves_runs_and_loses_little(spread, images):
    saved, with_racing, with_all = simulated(spread, images, searches=50)
    assert saved.mean() > 0.45
    assert with_racing.mean() < with_all.mean() + 0.1 * spread
