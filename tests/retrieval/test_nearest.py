import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from sextant.retrieval import nearest
from sextant.retrieval.nearest import nearest_neighbours, prepare_references, search_prepared

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
        monkeypatch.setattr(nearest, "BLOCK", block)
        assert np.array_equal(nearest_neighbours(reference, query, 5, similarity), whole)


def test_what_float32_cannot_tell_apart_is_told_apart():
    reference = np.full((3, 2), 4096, np.float32)
    reference[:, 0] += np.array([0.5, 0.001, 0.25], np.float32)
    assert nearest_neighbours(reference, reference, 1, "euclidean")[:, 0].tolist() == [0, 1, 2]


def test_cosine_does_not_see_the_length():
    reference, query = rows(30, 5), rows(9, 5, 1)
    scaled = reference * np.linspace(0.1, 10, 30, dtype=np.float32)[:, None]
    assert np.array_equal(nearest_neighbours(reference, query), nearest_neighbours(scaled, query))


@pytest.mark.parametrize("scale", [1e37, 1e25, 1e-20, 1e-30, 1e-40])
def test_cosine_does_not_see_lengths_whose_squares_are_no_float32(scale):
    plain = np.append(rows(20, 4), np.zeros((1, 4), np.float32), axis=0)
    reference = plain * np.float32(scale)
    for references, queries in ((reference, reference), (reference, plain), (plain, reference)):
        values, indices = search_prepared(prepare_references(references), queries[:20])
        assert indices[:, 0].tolist() == list(range(20))
        np.testing.assert_allclose(values, 1, rtol=1e-6 if scale > 1e-35 else 1e-3)


def test_neighbours_among_distances_whose_squares_are_no_float32():
    reference = rows(200, 4)
    query = reference[::-1] + 0.01 * rows(200, 4, 1)
    for scale in (1e-20, 1e-21, 1e-22, 1e-25):
        small = [each * np.float32(scale) for each in (reference, query)]
        assert np.array_equal(nearest_neighbours(*small, 3, "euclidean"), by_hand(*small, 3, "euclidean"))
    with pytest.raises(ValueError, match="too large for float32"):
        nearest_neighbours(reference, query * np.float32(1e25), 1, "euclidean")


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


@pytest.mark.parametrize("similarity", SIMILARITIES)
@given(seed=st.integers(0, 999), groups=st.integers(1, 40), k=st.integers(1, 30), distinct=st.integers(2, 400))
def test_the_bound_from_groups_loses_no_neighbour(similarity, seed, groups, k, distinct):
    """Few distinct rows in random order: ties and crowded groups."""
    places = np.random.default_rng(seed).integers(0, distinct, 700)
    reference, query = rows(distinct, 6, seed)[places], rows(9, 6, seed + 1)
    whole = nearest_neighbours(reference, query, k, similarity)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nearest, "GROUPS", groups)
        patch.setattr(nearest, "RECOMPARED", 30)
        assert np.array_equal(nearest_neighbours(reference, query, k, similarity), whole)
    by_score = by_hand(reference, query, len(reference), similarity)[:, :k]
    assert np.array_equal(reference[whole], reference[by_score])


def test_a_long_reference_is_searched_by_groups():
    reference, query = rows(3 * nearest.GROUPS + 17, 8), rows(20, 8, 1)
    query[0] = reference[-1]  # past the last whole group
    assert np.array_equal(nearest_neighbours(reference, query, 7), by_hand(reference, query, 7, "cosine"))


@pytest.mark.parametrize("similarity", SIMILARITIES)
def test_values_are_the_similarities_or_distances_of_the_neighbours(similarity):
    reference, query = rows(60, 7), rows(11, 7, 1)
    values, indices = search_prepared(prepare_references(reference, similarity), query, 5)
    chosen, wide = reference[indices].astype(float), query[:, None].astype(float)
    expected = np.linalg.norm(chosen - wide, axis=2)
    if similarity == "cosine":
        expected = (chosen * wide).sum(2) / np.linalg.norm(chosen, axis=2) / np.linalg.norm(wide, axis=2)
    np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-6)
    falling = values if similarity == "cosine" else -values
    assert (np.diff(falling, axis=1) <= 0).all()


@pytest.mark.parametrize(
    ("reference", "complaint"),
    [
        (np.zeros((0, 3), np.float32), "at least one reference"),
        (np.full((2, 3), 1e30, np.float32), "too large for float32"),
        (np.zeros((2, 3)), "float32"),
    ],
)
def test_bad_references_are_refused(reference, complaint):
    with pytest.raises((ValueError, TypeCheckError), match=f"{complaint}|Type-check error"), np.errstate(over="ignore"):
        prepare_references(reference, "euclidean")


def test_an_unknown_similarity_is_refused():
    with pytest.raises((ValueError, TypeCheckError), match=r"must be cosine or euclidean|Type-check error"):
        prepare_references(rows(2, 3), "manhattan")
