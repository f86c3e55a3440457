import numpy as np
import pytest
import scipy.sparse
from hypothesis import given
from hypothesis import strategies as st

from sextant.evaluation.positives import Positives


def random_mask(seed, shape=(7, 11)):
    return np.random.default_rng(seed).random(shape) < 0.2


def mask_of(positives):
    return np.array([np.isin(np.arange(positives.references), row) for row in positives])


@given(seed=st.integers(0, 999))
def test_mask_lists_and_sparse_matrices_say_the_same(seed):
    mask = random_mask(seed)
    lists = [np.flatnonzero(row)[::-1] for row in mask]  # in any order
    each = [
        Positives.from_mask(mask),
        Positives.from_lists(lists, mask.shape[1]),
        Positives.from_sparse(scipy.sparse.csr_array(mask)),
        Positives.from_sparse(scipy.sparse.coo_array(mask.astype(float))),
    ]
    for positives in each:
        assert np.array_equal(mask_of(positives), mask)
        assert np.array_equal(positives.counts, mask.sum(1))
        assert positives.unmatchable == (~mask.any(1)).sum()
        assert all(np.array_equal(positives[i], np.flatnonzero(row)) for i, row in enumerate(mask))


@given(seed=st.integers(0, 999), k=st.integers(1, 5))
def test_hits_are_looked_up_in_the_mask(seed, k):
    mask = random_mask(seed)
    neighbours = np.random.default_rng(seed).integers(0, 11, (7, k))
    assert np.array_equal(Positives.from_mask(mask).hits(neighbours), np.take_along_axis(mask, neighbours, axis=1))


@given(seed=st.integers(0, 999), tolerance=st.integers(0, 5))
def test_frames_within_the_tolerance_are_positives_in_any_order_of_frames(seed, tolerance):
    rng = np.random.default_rng(seed)
    query, reference = rng.integers(0, 30, 8), rng.integers(0, 30, 13)
    expected = np.abs(query[:, None] - reference) <= tolerance
    assert np.array_equal(mask_of(Positives.within_frames(query, reference, tolerance)), expected)


def test_repeated_positives_count_once_and_stored_zeros_do_not():
    assert Positives.from_lists([[3, 1, 3]], 4)[0].tolist() == [1, 3]
    stored = scipy.sparse.csr_array((np.array([0.0, 2.0]), np.array([0, 1]), np.array([0, 2])), shape=(1, 3))
    assert Positives.from_sparse(stored)[0].tolist() == [1]
    assert stored.nnz == 2  # the caller's matrix is as it was


def test_large_numbers_of_pairs_do_not_overflow():
    positives = Positives.from_lists([[]] * 99_999 + [[99_999]], 100_000)
    hits = positives.hits(np.full((100_000, 1), 99_999))
    assert (hits.sum(), hits[-1, 0]) == (1, True)


@pytest.mark.parametrize("lists", [[[4]], [[-1]]])
def test_positives_outside_the_references_are_refused(lists):
    with pytest.raises(ValueError, match=r"positives must be in \[0, 4\)"):
        Positives.from_lists(lists, 4)


def test_broken_rows_are_refused():
    for starts, indices in (([0, 1], []), ([0, 2], [1, 1]), ([0, 2, 1, 3], [0, 1, 2])):
        with pytest.raises(ValueError, match=r"starts|ascending"):
            Positives(np.array(starts, np.int64), np.array(indices, np.int64), 4)


def test_neighbours_of_other_queries_or_references_are_refused():
    positives = Positives.from_lists([[0], [1]], 2)
    with pytest.raises(ValueError, match="neighbours of 2 queries"):
        positives.hits(np.zeros((3, 1), np.int64))
    with pytest.raises(ValueError, match=r"neighbours must be in \[0, 2\)"):
        positives.hits(np.array([[0], [2]]))
    with pytest.raises(ValueError, match="at least 0 frames"):
        Positives.within_frames(np.arange(2), np.arange(2), -1)
