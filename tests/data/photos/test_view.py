import numpy as np
import pytest
from data.photos.pictures import scene
from hypothesis import given
from hypothesis import strategies as st

from sextant.data.photos import Photo, network_view

ASPECTS = (1.0, 1.25, 4 / 3, 1.5, 16 / 9)


@given(st.integers(32, 500), st.integers(32, 500))
def test_the_part_is_the_largest_centred_one_of_a_trained_aspect(width, height):
    photo = Photo(np.zeros((height, width, 3), np.uint8), width, height, 1, None)
    view = network_view(photo, ASPECTS, 24, 18)
    assert view.image.shape == (18, 24, 3)
    assert view.width / view.height == pytest.approx(view.aspect)
    assert view.aspect in ASPECTS
    assert view.left == pytest.approx((width - view.width) / 2)
    assert view.top == pytest.approx((height - view.height) / 2)
    assert min(view.left, view.top) == pytest.approx(0, abs=1e-9)
    shares = [min(a * height, width) * min(width / a, height) / (width * height) for a in ASPECTS]
    assert view.share == pytest.approx(max(shares))


def test_a_portrait_photo_is_cut_to_its_full_width():
    photo = Photo(np.zeros((400, 300, 3), np.uint8), 300, 400, 1, None)
    view = network_view(photo, (4 / 3,), 24, 18)
    assert (view.left, view.width) == (0, 300)
    assert (view.top, view.height) == (87.5, 225)


@pytest.mark.parametrize("size", [(480, 360), (481, 367), (1200, 500), (360, 480), (50, 40)])
def test_pixels_of_the_view_are_means_over_their_areas(size):
    width, height = size
    photo = Photo(scene(width, height), width, height, 1, None)
    view = network_view(photo, (4 / 3,), 48, 36)
    columns = view.left + (np.arange(48) + 0.5) / 48 * view.width
    rows = view.top + (np.arange(36) + 0.5) / 36 * view.height
    np.testing.assert_allclose(view.image[..., 0].mean(0), 60 + 150 * (columns - 0.5) / (width - 1), atol=2)
    np.testing.assert_allclose(view.image[..., 1].mean(1), 40 + 180 * (rows - 0.5) / (height - 1), atol=2)


def test_fine_patterns_are_averaged_and_not_sampled():
    checks = np.repeat(255 * (np.indices((360, 480)).sum(0) % 2)[..., None], 3, 2).astype(np.uint8)
    view = network_view(Photo(checks, 480, 360, 1, None), (4 / 3,), 48, 36)
    assert set(np.unique(view.image)) <= {127, 128}


@given(st.integers(32, 500), st.integers(32, 500))
def test_on_a_canvas_a_photo_of_any_shape_is_seen_whole_and_unsquashed(width, height):
    photo = Photo(np.full((height, width, 3), 200, np.uint8), width, height, 1, None)
    view = network_view(photo, (9 / 16, 16 / 9), 48, 48, canvas=True)
    lit = view.image[..., 0] == 200
    rows, columns = lit.any(1).sum(), lit.any(0).sum()
    assert max(rows, columns) == 48
    assert lit.sum() == rows * columns
    np.testing.assert_array_equal(view.image, view.image[::-1, ::-1])  # in the middle
    assert view.width / view.height == pytest.approx(columns / rows) == pytest.approx(view.aspect)
    if 9 / 16 <= width / height <= 16 / 9:
        assert view.share > 1 - 2 / min(rows, columns)  # the canvas has whole pixels, alike on both sides
