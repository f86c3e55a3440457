import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from scipy import stats

from sextant.evaluation import retrieval
from sextant.evaluation.retrieval import nearest_neighbours, recall_name, recall_within_frames

SIMILARITIES = ("cosine", "euclidean")


def rows(count, length, seed=0):
    return np.random.default_rng(seed).normal(size=(count, length)).astype(np.float32)


def by_hand(reference, query, k, similarity):
    """All pairs in float64, sorted by score and then by index."""
    reference, query = reference.astype(float), query.astype(float)
    if similarity == "cosine":
        reference, query = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (reference, query))
    distance = ((query[:, None] - reference) ** 2).sum(2)
    return np.argsort(distance, axis=1, kind="stable")[:, :k]


@pytest.mark.parametrize("similarity", SIMILARITIES)
@given(seed=st.integers(0, 999), count=st.integers(1, 40), length=st.integers(1, 9), data=st.data())
def test_neighbours_are_those_of_all_pairs_compared(similarity, seed, count, length, data):
    k = data.draw(st.integers(1, count))
    reference, query = rows(count, length + 1, seed), rows(7, length + 1, seed + 1)
    assert np.array_equal(nearest_neighbours(reference, query, k, similarity), by_hand(reference, query, k, similarity))


@pytest.mark.parametrize("similarity", SIMILARITIES)
@given(seed=st.integers(0, 999), copies=st.integers(2, 9), length=st.integers(1, 300))
def test_equal_descriptors_come_in_the_order_of_their_indices(similarity, seed, copies, length):
    distinct = 5 * rows(6, length + 1, seed)
    reference = np.tile(distinct, (copies, 1))
    found = nearest_neighbours(reference, distinct, copies, similarity)
    assert np.array_equal(found, np.arange(6)[:, None] + 6 * np.arange(copies))


@pytest.mark.parametrize("similarity", SIMILARITIES)
def test_the_size_of_the_blocks_changes_nothing(similarity, monkeypatch):
    reference = np.concatenate([rows(50, 33), rows(50, 33)]) + np.float32(30)
    query = reference[::3] + 1e-3 * rows(34, 33, 2)
    whole = nearest_neighbours(reference, query, 5, similarity)
    for block in (1, 700, 1900):
        monkeypatch.setattr(retrieval, "BLOCK", block)
        assert np.array_equal(nearest_neighbours(reference, query, 5, similarity), whole)


def test_what_float32_cannot_tell_apart_is_told_apart():
    reference = np.full((3, 2), 4096, np.float32)
    reference[:, 0] += np.array([0.5, 0.001, 0.25], np.float32)
    assert nearest_neighbours(reference, reference, 1, "euclidean")[:, 0].tolist() == [0, 1, 2]


def test_cosine_does_not_see_the_length():
    reference, query = rows(30, 5), rows(9, 5, 1)
    scaled = reference * np.linspace(0.1, 10, 30, dtype=np.float32)[:, None]
    assert np.array_equal(nearest_neighbours(reference, query), nearest_neighbours(scaled, query))


def test_a_query_of_zeros_is_equally_near_to_all():
    found = nearest_neighbours(rows(5, 3), np.zeros((1, 3), np.float32), 5)
    assert found.tolist() == [[0, 1, 2, 3, 4]]


def test_a_reference_of_zeros_does_not_attract():
    reference = np.concatenate([np.zeros((1, 3), np.float32), rows(4, 3)])
    assert nearest_neighbours(reference, reference[1:])[:, 0].tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("reference", "query", "k", "complaint"),
    [
        (rows(3, 2), rows(3, 2), 4, r"k=4 must be in \[1, 3\]"),
        (rows(3, 2), rows(3, 2), 0, r"k=0 must be in \[1, 3\]"),
        (rows(3, 2), rows(3, 4), 1, "rows of one length"),
        (rows(3, 2) * np.float32("nan"), rows(3, 2), 1, "not finite"),
    ],
)
def test_bad_arguments_are_refused(reference, query, k, complaint):
    with pytest.raises((ValueError, TypeCheckError), match=f"{complaint}|Type-check error"):
        nearest_neighbours(reference, query, k)


def test_the_name_of_a_recall_carries_its_protocol():
    assert (recall_name(1), recall_name(10, 5)) == ("R@1_pm1f", "R@5_pm10f")


@pytest.mark.parametrize("similarity", SIMILARITIES)
def test_identical_traverses_are_recalled_whole(similarity):
    places = rows(200, 16)
    assert recall_within_frames(places, places, 0, similarity) == 1


@given(shift=st.integers(0, 6), tolerance=st.integers(0, 6))
def test_a_shifted_traverse_is_recalled_within_the_shift(shift, tolerance):
    places = rows(100, 16)
    recall = recall_within_frames(places, np.roll(places, shift, axis=0), tolerance)
    assert recall == (1 if shift == 0 else (1 - shift / 100) * (shift <= tolerance))


@pytest.mark.parametrize("tolerance", [0, 1, 3])
def test_shuffled_traverses_are_recalled_by_chance(tolerance):
    count, repeats = 300, 20
    places, rng = rows(count, 16), np.random.default_rng(1)
    hits = sum(count * recall_within_frames(places, places[rng.permutation(count)], tolerance) for _ in range(repeats))
    low, high = stats.binom.interval(0.999, count * repeats, (2 * tolerance + 1) / count)
    assert low <= hits <= high


def test_traverses_of_different_length_are_refused():
    with pytest.raises(ValueError, match="as many frames each; got 4 and 3"):
        recall_within_frames(rows(4, 2), rows(3, 2))
