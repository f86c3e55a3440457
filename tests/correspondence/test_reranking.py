"""Inliers of candidates, and the rule by which they replace the retrieval's answer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from sextant.correspondence import LocalFeatures, epipolar_inliers
from sextant.correspondence.reranking import FITTED, LEVEL, count_inliers, reranked, significantly_more
from sextant.errors import ArgumentError

COUNTS = st.lists(st.integers(0, 400), min_size=1, max_size=20)


@given(counts=COUNTS)
def test_the_order_is_a_permutation_and_depends_on_nothing_else(counts):
    order = reranked(np.array(counts))
    assert sorted(order.tolist()) == list(range(len(counts)))
    assert order.tolist() == reranked(np.array(counts)).tolist()


@given(counts=COUNTS)
def test_the_first_answer_is_replaced_by_the_most_inliers_and_only_if_they_are_significantly_more(counts):
    first, most = reranked(np.array(counts))[0], int(np.argmax(counts))
    if len(counts) > 1 and significantly_more(counts[most], counts[0], len(counts) - 1):
        assert first == most
    else:
        assert first == 0


@given(evidence=st.integers(0, 300), other=st.integers(0, 300), compared=st.integers(1, 50))
def test_the_test_is_the_exact_one_of_two_poisson_counts(evidence, other, compared):
    tail = binom.pmf(np.arange(evidence, evidence + other + 1), evidence + other, 0.5).sum()
    if abs(tail - LEVEL / compared) > 1e-9:
        assert significantly_more(evidence + FITTED, other + FITTED, compared) == (tail < LEVEL / compared)


def test_equally_good_candidates_are_confused_at_most_as_often_as_the_level():
    rng = np.random.default_rng(0)
    for rate in (3, 30, 300):
        counts = FITTED + rng.poisson(rate, (1000, 15))
        replaced = np.mean([reranked(each)[0] != 0 for each in counts])
        assert replaced <= LEVEL + 3 * np.sqrt(LEVEL / 1000)


@pytest.mark.parametrize(
    ("counts", "order"),
    [
        ([200, 220, 210], [0, 1, 2]),  # saturated: the retrieval decides
        ([12, 16, 90, 85], [2, 3, 0, 1]),
        ([0, 9, 0], [0, 1, 2]),  # two inliers beyond the seven that any matrix fits
        ([0, 0, 0], [0, 1, 2]),
        ([5], [0]),
    ],
)
def test_orders(counts, order):
    assert reranked(np.array(counts)).tolist() == order


# --- inliers ----------------------------------------------------------------------------------------------------------


def seen(points, names, rotation, position, size=(640, 480), focal=500.0):
    """Features of points of the world with a descriptor each, seen by a camera."""
    inside = (points - position) @ Rotation.from_rotvec(rotation).as_matrix()
    pixels = inside[:, :2] / inside[:, 2:] * focal + (size[0] / 2, size[1] / 2)
    return LocalFeatures(pixels.astype(np.float32), names, *size)


@pytest.fixture
def scene():
    rng = np.random.default_rng(0)
    names = rng.normal(size=(200, 64))
    names /= np.linalg.norm(names, axis=1, keepdims=True)
    return rng.uniform((-2, -2, 4), (2, 2, 9), (200, 3)), names.astype(np.float16)


def test_features_of_one_scene_are_inliers_and_others_are_not(scene):
    pytest.importorskip("poselib")
    points, names = scene
    query = seen(points, names, (0, 0, 0), (0, 0, 0))
    same = seen(points, names, (0, 0.1, 0.02), (0.6, 0, 0.2))
    shuffled = seen(points[np.random.default_rng(1).permutation(200)], names, (0, 0.1, 0.02), (0.6, 0, 0.2))
    few = same.strongest(7)
    found = count_inliers(query, [shuffled, same, few])
    assert found[1] == 200
    assert FITTED <= found[0] < 60
    assert found[2] == 0
    assert reranked(found).tolist() == [1, 0, 2]
    assert count_inliers(query, []).shape == (0,)


def test_distances_are_measured_in_images_of_one_size(scene):
    """A photo and its enlargement have the same inliers."""
    pytest.importorskip("poselib")
    points, names = scene
    query, same = seen(points, names, (0, 0, 0), (0, 0, 0)), seen(points, names, (0, 0.1, 0.02), (0.6, 0, 0.2))
    noise = np.random.default_rng(2).normal(scale=3, size=same.points.shape).astype(np.float32)
    blurred = LocalFeatures(same.points + noise, names, 640, 480)
    larger = LocalFeatures(4 * blurred.points, names, 4 * 640, 4 * 480)
    found = count_inliers(query, [blurred, larger])
    assert 60 < found[0] < 200
    assert found[1] == found[0]


@pytest.mark.parametrize(
    ("shapes", "error_px", "said"),
    [
        (((5000, 2), (10, 2)), 3.0, r"second has the shape \(10, 2\), but must have \(5000, 2\)"),
        (((9, 3), (9, 3)), 3.0, r"first has the shape \(9, 3\), but must have \(m, 2\)"),
        (((9, 2), (9, 2)), -1.0, "error_px=-1.0 must be above 0"),
    ],
)
def test_pixels_that_do_not_match_and_errors_below_zero_are_refused(shapes, error_px, said):
    with pytest.raises(ArgumentError, match=said):
        epipolar_inliers(*(np.zeros(shape, np.float32) for shape in shapes), error_px)


@pytest.mark.parametrize("wrong", [{"side": 0}, {"error_px": np.nan}])
def test_inliers_are_counted_in_pixels(scene, wrong):
    one = seen(*scene, (0, 0, 0), (0, 0, 0))
    with pytest.raises(ArgumentError, match=f"{next(iter(wrong))}=.* must be"):
        count_inliers(one, [], **wrong)
