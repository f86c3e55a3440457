"""Who is at whose place, against every pair worked out one by one."""

import numpy as np
import pytest
from data.places.place_pictures import aligned_places
from hypothesis import given
from hypothesis import strategies as st

from sextant.chapters.places.data import ImageRows, PlaceImages, PlaceTolerance
from sextant.chapters.places.data.images import within_distance
from sextant.errors import UserError

# coordinates on a coarse grid, so that distances equal to the tolerance are common
GRID = st.integers(0, 12).map(lambda n: n * 0.5)
PLACE = st.tuples(GRID, GRID, st.integers(-3, 6).map(lambda n: n * 90.0 + 15))


def positioned(places, traverses=2):
    n = len(places)
    x, y, heading = np.array(places, float).reshape(n, 3).T
    return PlaceImages(
        ImageRows(np.zeros((n, 4, 6, 3), np.uint8)), np.arange(n) % traverses,
        tuple(f"season{t}" for t in range(traverses)), np.arange(n) // traverses, ("",) * n,
        np.stack([x, y], -1), heading, aligned=False,
    )  # fmt: skip


@given(
    st.lists(PLACE, min_size=1, max_size=30),
    st.sampled_from([0.0, 0.5, 1.0, 2.5]),
    st.sampled_from([None, 45, 90, 180]),
)
def test_positives_by_distance_and_heading_are_those_of_every_pair(places, positive, heading):
    images = positioned(places)
    tolerance = PlaceTolerance("m", positive, 3.0, heading)
    rows = np.arange(len(images))
    found = images.positives(rows, rows[::-1], tolerance).toarray()
    near = images.not_negatives(rows, rows[::-1], tolerance).toarray()
    for q in rows:
        for column, r in enumerate(rows[::-1]):
            (ax, ay, a), (bx, by, b) = places[q], places[r]
            apart = np.hypot(ax - bx, ay - by)
            angle = abs(np.angle(np.exp(1j * np.radians(a - b)), deg=True))
            same = q != r and apart <= positive and (heading is None or angle <= heading + 1e-9)
            assert found[q, column] == same
            assert near[q, column] == (apart < 3.0)


@given(st.integers(1, 15), st.integers(1, 3), st.integers(0, 4), st.integers(0, 2**31))
def test_positives_by_frame_are_those_of_every_pair(frames, traverses, positive, seed):
    images = aligned_places(frames, traverses)
    tolerance = PlaceTolerance("frames", positive, positive + 3)
    rng = np.random.default_rng(seed)
    queries, references = (rng.permutation(len(images))[: rng.integers(1, len(images) + 1)] for _ in range(2))
    found, near = images.positives(queries, references, tolerance), images.not_negatives(queries, references, tolerance)
    apart = np.abs(images.frame[queries][:, None] - images.frame[references])
    assert np.array_equal(found.toarray(), (apart <= positive) & (queries[:, None] != references))
    assert np.array_equal(near.toarray(), apart < positive + 3)
    assert found.has_sorted_indices


def test_every_positive_is_not_a_negative():
    images = positioned([(0, 0, 0), (1, 0, 0), (2, 0, 0), (9, 0, 0)])
    rows = np.arange(4)
    tolerance = PlaceTolerance("m", 1, 2)
    positive, near = (f(rows, rows, tolerance).toarray() for f in (images.positives, images.not_negatives))
    assert not (positive & ~near).any()
    assert not near[0, 2]  # exactly the negative tolerance away: a negative


def test_many_thousand_places_take_memory_for_their_pairs_alone():
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 30_000, (20_000, 2))
    matrix = within_distance(places, places, 25.0)
    assert matrix.nnz < 40_000 + 20_000 * 20_000 * 3 * 25**2 / 30_000**2
    assert matrix.indices.dtype == np.int32
    one = 123
    assert np.array_equal(matrix[[one]].indices, np.flatnonzero(np.hypot(*(places - places[one]).T) <= 25))


def test_a_query_without_a_positive_has_an_empty_row():
    images = aligned_places(5, 2)
    rows = np.flatnonzero(images.traverse == 1)
    matrix = images.positives(rows, np.array([0, 1]), PlaceTolerance("frames", 0, 2))
    assert np.diff(matrix.indptr).tolist() == [1, 1, 0, 0, 0]
    assert images.positives(rows, np.array([], int), PlaceTolerance("frames", 0, 2)).shape == (5, 0)


def test_units_that_are_not_known_are_refused():
    rows = np.arange(2)
    with pytest.raises(UserError, match="positions of these images are not known"):
        aligned_places().positives(rows, rows, PlaceTolerance("m", 5, 25))
    with pytest.raises(UserError, match="not aligned"):
        positioned([(0, 0, 0)] * 2).positives(rows, rows, PlaceTolerance("frames", 1, 10))
    with pytest.raises(UserError, match="headings"):
        aligned_places().positives(rows, rows, PlaceTolerance("frames", 1, 10, 30))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [(("km", 1, 2), "unit"), (("m", 2, 2), "negative above"), (("m", -1, 2), "at least 0"),
     (("m", 1, float("nan")), "negative"), (("m", 1, 2, 0), "heading_deg"), (("m", 1, 2, 190), "heading_deg")],
)  # fmt: skip
def test_tolerances_without_a_meaning_are_refused(arguments, told):
    with pytest.raises(UserError, match=told):
        PlaceTolerance(*arguments)


def test_tolerances_have_names():
    assert PlaceTolerance("frames", 1, 10).name == "pm1f"
    assert PlaceTolerance("m", 5, 25).name == "5m"
    assert PlaceTolerance("m", 2.5, 25, 30).name == "2.5m_30deg"


def test_positions_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="finite"):
        within_distance(np.array([[0, np.nan]]), np.zeros((1, 2)), 1.0)


# -- images ------------------------------------------------------------------------------------------------------------


def test_images_are_indexed_like_an_array():
    whole = np.random.default_rng(0).integers(0, 256, (9, 4, 5, 3), np.uint8)
    rows = ImageRows(whole, np.array([7, 1, 4]))
    assert rows.shape == (3, 4, 5, 3)
    assert np.array_equal(rows[[2, 0]], whole[[4, 7]])
    assert np.array_equal(rows[1], whole[1])
    assert np.array_equal(rows[np.array([True, False, True])], whole[[7, 4]])
    assert np.array_equal(np.asarray(rows), whole[[7, 1, 4]])
    rows[1][:] = 0
    assert np.array_equal(rows[1], whole[1])
    assert np.array_equal(rows.select(np.array([2]))[:], whole[[4]])


def test_parts_keep_images_and_places_together():
    images = aligned_places(6, 3)
    part = images.only_conditions(["season2", "season0"])
    assert part.conditions == ("season2", "season0")
    assert np.array_equal(part.images[:][:, 0, 0, 0], np.r_[200:206, 0:6])
    assert np.array_equal(part.traverse, np.repeat([0, 1], 6))
    assert part.names[0] == "2/0"
    with pytest.raises(UserError, match="no condition 'autumn'"):
        images.only_conditions(["autumn"])
    with pytest.raises(ValueError, match="different lengths"):
        PlaceImages(images.images, images.traverse, images.conditions, images.frame[1:], images.names)


def test_flat_and_still_frames_are_flagged():
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 256, (8, 12, 16, 3), np.uint8)
    pixels[2] = 20  # a tunnel
    pixels[5] = pixels[4]  # a stop
    pixels[6, 0, 0] = pixels[5, 0, 0]
    images = PlaceImages(
        ImageRows(pixels), np.array([0, 0, 0, 0, 1, 1, 1, 1]), ("a", "b"), np.array([0, 1, 2, 3, 0, 1, 2, 3]), ("",) * 8
    )
    assert np.flatnonzero(images.flat).tolist() == [2]
    assert np.flatnonzero(images.still).tolist() == [5]
