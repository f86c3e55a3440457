"""What equal pictures leave to single images."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.chapters.places.metrics import picture_runs, single_image_ceiling, standstill
from sextant.evaluation.positives import Positives

FLAGS = st.lists(st.booleans(), min_size=1, max_size=12).map(lambda flags: np.array(flags))


def brute_force(mask, query_run, reference_run):
    """Every answer to every run of queries is tried; of the right ones the share is counted one by one."""
    total = 0.0
    for q in set(query_run.tolist()):
        shares = []
        for r in set(reference_run.tolist()):
            members = np.flatnonzero(reference_run == r)
            shares.append(sum(np.mean([mask[i, j] for j in members]) for i in np.flatnonzero(query_run == q)))
        total += max(shares)
    return total / len(query_run)


@given(FLAGS, FLAGS, st.integers(0, 3), st.integers(0, 999))
def test_it_is_the_best_of_all_answers(query_flags, reference_flags, tolerance, seed):
    query, reference = picture_runs(query_flags), picture_runs(reference_flags)
    rng = np.random.default_rng(seed)
    mask = np.abs(np.arange(len(query))[:, None] - np.arange(len(reference))) <= tolerance
    mask &= rng.random(mask.shape) < 0.8  # some queries lose their positives
    found = single_image_ceiling(Positives.from_mask(mask), query, reference)
    assert found == pytest.approx(brute_force(mask, query, reference))


@given(FLAGS, st.integers(0, 2), st.integers(0, 99))
def test_a_descriptor_of_the_runs_that_guesses_evenly_does_not_beat_it_and_the_best_one_reaches_it(flags, within, seed):
    """References of a run are equal to the descriptor: it names one of them at random."""
    runs, frames = picture_runs(flags), np.arange(len(flags))
    positives = Positives.within_frames(frames, frames, within)
    ceiling = single_image_ceiling(positives, runs, runs)
    rng = np.random.default_rng(seed)
    answers = rng.integers(0, runs[-1] + 1, runs[-1] + 1)  # run of references named for each run of queries
    mask = np.array([np.isin(frames, row) for row in positives])
    expected = np.mean([mask[i, runs == answers[runs[i]]].mean() for i in frames])
    assert expected <= ceiling + 1e-12
    assert np.mean([mask[i, runs == runs[i]].mean() for i in frames]) <= ceiling + 1e-12


def test_without_equal_pictures_only_queries_without_a_positive_are_missed():
    none = np.zeros(5, bool)
    positives = Positives.from_lists([[0], [1, 2], [], [3], [4]], 5)
    assert single_image_ceiling(positives, picture_runs(none), picture_runs(none)) == pytest.approx(4 / 5)


def test_a_stop_of_five_frames_by_hand():
    """Within one frame, frames 1 to 5 stand: of the five, the ends have 2 positives in the run, the middle ones 3."""
    runs = picture_runs(np.array([False, False, True, True, True, True, False]))
    assert runs.tolist() == [0, 1, 1, 1, 1, 1, 2]
    frames = np.arange(7)
    positives = Positives.within_frames(frames, frames, 1)
    assert single_image_ceiling(positives, runs, runs) == pytest.approx((1 + (2 + 3 + 3 + 3 + 2) / 5 + 1) / 7)


@given(FLAGS)
def test_a_standstill_is_a_run_of_two_or_more(flags):
    lengths = [len(list(members)) for _, members in groupby(picture_runs(flags).tolist())]
    assert standstill(flags).tolist() == [length > 1 for length in lengths for _ in range(length)]
    after = np.append(flags[1:], False)
    before = flags.copy()
    before[0] = False
    assert standstill(flags).tolist() == (before | after).tolist()


def test_nothing_and_what_does_not_fit():
    empty = np.zeros(0, np.int64)
    assert np.isnan(single_image_ceiling(Positives.from_lists([], 3), empty, np.arange(3)))
    assert standstill(np.zeros(0, bool)).shape == (0,)
    with pytest.raises(ValueError, match="need runs of 2 queries and 3 references; got 2 and 2"):
        single_image_ceiling(Positives.from_lists([[0], [1]], 3), np.arange(2), np.arange(2))
