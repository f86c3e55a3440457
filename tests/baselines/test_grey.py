import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from PIL import Image

from sextant.baselines import grey_images


def noise(*shape, seed=0):
    return np.random.default_rng(seed).integers(256, size=shape).astype(np.uint8)


def test_luma_is_that_of_pillow_to_its_rounding():
    images = noise(3, 8, 9, 3)
    expected = np.stack([np.asarray(Image.fromarray(image).convert("L")) for image in images])
    np.testing.assert_allclose(255 * grey_images(images, 8, 9), expected, atol=0.51)


@given(st.integers(0, 255), st.integers(1, 20), st.integers(1, 20))
def test_a_flat_image_stays_flat_at_any_size(value, height, width):
    grey = grey_images(np.full((1, 7, 5, 3), value, np.uint8), height, width)
    assert grey.shape == (1, height, width)
    np.testing.assert_allclose(grey, value / 255, atol=1e-6)


def test_one_channel_is_three_equal_ones():
    images = noise(2, 8, 8, 1)
    np.testing.assert_allclose(grey_images(images, 4, 6), grey_images(images.repeat(3, 3), 4, 6), atol=1e-6)


def test_large_images_are_grey_one_at_a_time():
    images = noise(40, 300, 400, 3)
    tracemalloc.start()
    grey_images(images, 8, 8)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < images.nbytes  # in float32 they are four times that


def test_shrinking_keeps_the_mean():
    images = noise(2, 64, 128, 3)
    assert grey_images(images, 16, 32).mean() == pytest.approx(grey_images(images, 64, 128).mean(), abs=2e-3)


@pytest.mark.parametrize(
    "images", [np.zeros((0, 4, 4, 3), np.uint8), np.zeros((2, 4, 4, 2), np.uint8), np.zeros((2, 4, 4, 3))]
)
def test_what_is_no_image_is_refused(images):
    with pytest.raises((ValueError, TypeCheckError), match=r"need uint8 images|Type-check error"):
        grey_images(images, 4, 4)
