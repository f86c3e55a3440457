import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.retrieval.sequence_matching import local_contrast, match_sequences, sequence_scores


def rows(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def by_hand(similarities, length, velocities, ahead=0):
    """The equation of the module, loop by loop, in float64."""
    m, n = similarities.shape
    wide = similarities.astype(float)
    result = np.empty((m, n))
    for i, j in np.ndindex(m, n):
        lines = []
        for velocity in velocities:
            line = []
            for lag in range(-ahead, length - ahead):
                if 0 <= i - lag < m:
                    column = j - int(np.rint(lag * velocity))
                    line.append(wide[i - lag, column] if 0 <= column < n else wide[i - lag].mean())
            lines.append(np.mean(line))
        result[i, j] = max(lines)
    return result


@given(
    seed=st.integers(0, 999),
    m=st.integers(1, 9),
    n=st.integers(1, 9),
    length=st.integers(1, 7),
    velocities=st.lists(st.sampled_from([-1.0, 0.0, 0.5, 0.8, 1.0, 1.3, 3.0]), min_size=1, max_size=3),
    centred=st.booleans(),
)
def test_scores_are_those_of_the_equation(seed, m, n, length, velocities, centred):
    similarities = rows(m, n, seed=seed) + 2
    expected = by_hand(similarities, length, velocities, length // 2 if centred else 0)
    np.testing.assert_allclose(sequence_scores(similarities, length, velocities, centred=centred), expected, atol=1e-4)


def test_length_one_is_the_similarity_itself():
    similarities = rows(5, 8)
    np.testing.assert_allclose(sequence_scores(similarities, 1), similarities, atol=1e-6)


def test_aligned_rides_are_summed_along_the_diagonal():
    similarities = rows(30, 30)
    scores = sequence_scores(similarities, 4, (1.0,))
    diagonal = np.diag(similarities)
    np.testing.assert_allclose(np.diag(scores)[3:], np.convolve(diagonal, np.ones(4) / 4, "valid"), atol=1e-5)


@pytest.mark.parametrize("velocity", [0.8, 1.2, -1.0])
def test_a_ride_at_another_velocity_is_found_only_if_it_is_searched(velocity):
    """References that a query passes are a little more alike; one image is not enough to tell."""
    rng, m, n = np.random.default_rng(0), 100, 220
    passed = np.rint(110 + velocity * (np.arange(m) - 50)).astype(int)
    similarities = rng.normal(size=(m, n)).astype(np.float32)
    similarities[np.arange(m), passed] += 2
    late = np.arange(m) >= 20

    def right(*velocities):
        found = match_sequences(similarities, length=20, velocities=velocities).indices[:, 0]
        return (np.abs(found - passed) <= 1)[late].mean()

    assert right(velocity) > 0.95
    assert right(1.0) < 0.7
    assert right(0.8, 0.9, 1.0, 1.1, 1.2, -1.0) > 0.9


def test_matches_come_best_first_and_equal_ones_by_index():
    similarities = np.array([[0.5, 0.9, 0.9, 0.1]], np.float32)
    scores, indices = match_sequences(similarities, 3, length=1)
    assert indices.tolist() == [[1, 2, 0]]
    np.testing.assert_allclose(scores, [[0.9, 0.9, 0.5]], atol=1e-6)


def test_the_future_is_not_used_unless_asked_for():
    similarities = rows(20, 20)
    changed = similarities.copy()
    changed[12:] = rows(8, 20, seed=9)
    assert np.array_equal(sequence_scores(similarities, 6)[:12], sequence_scores(changed, 6)[:12])
    centred = [sequence_scores(each, 6, centred=True)[:12] for each in (similarities, changed)]
    assert not np.array_equal(*centred)
    assert np.array_equal(*(each[:9] for each in centred))  # three frames ahead


@given(seed=st.integers(0, 999), count=st.integers(1, 30), window=st.integers(2, 12))
def test_contrast_is_that_of_a_loop(seed, count, window):
    similarities = rows(4, count, seed=seed) + 100
    expected = np.empty((4, count))
    for j in range(count):
        near = similarities[:, max(j - window // 2, 0) : j + window // 2 + 1].astype(float)
        expected[:, j] = (similarities[:, j] - near.mean(1)) / np.maximum(near.std(1), 1e-6)
    np.testing.assert_allclose(local_contrast(similarities, window), expected, atol=1e-4)


def test_contrast_takes_out_stretches_that_look_like_everything():
    rng = np.random.default_rng(0)
    similarities = rng.normal(size=(60, 60)).astype(np.float32) + 8 * np.eye(60, dtype=np.float32)
    similarities[:, 20:40] += 20
    options = {"length": 5, "velocities": (1.0,)}
    plain = match_sequences(similarities, **options).indices[:, 0]
    contrasted = match_sequences(similarities, contrast_window=10, **options).indices[:, 0]
    assert (plain == np.arange(60)).mean() < 0.6
    assert (contrasted == np.arange(60)).mean() > 0.8


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"k": 9}, r"k=9 must be in \[1, 8\]"),
        ({"length": 0}, "length >= 1"),
        ({"velocities": ()}, "length >= 1 and finite velocities"),
        ({"velocities": (float("nan"),)}, "finite velocities"),
        ({"contrast_window": 1}, "window=1 must be at least 2"),
    ],
)
def test_bad_parameters_are_refused(options, complaint):
    with pytest.raises(ValueError, match=complaint):
        match_sequences(rows(5, 8), **options)


def test_similarities_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="finite similarities"):
        sequence_scores(np.full((2, 2), np.nan, np.float32))


@given(st.integers(0, 2**31))
def test_the_best_is_the_first_of_several_whatever_is_asked_for(seed):
    similarities = np.random.default_rng(seed).integers(0, 2, (6, 9)).astype(np.float32)  # with ties
    one, several = (match_sequences(similarities, k, length=2, velocities=(1.0,)) for k in (1, 4))
    assert np.array_equal(one.indices[:, 0], several.indices[:, 0])
    assert np.array_equal(one.scores[:, 0], several.scores[:, 0])
