import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.corruptions.filtering import clipped_zoom


def slowly(image, factor):
    """The authors' zoom of a square grey image, with scipy."""
    size = len(image)
    kept = int(np.ceil(size / factor))
    first = (size - kept) // 2
    zoomed = ndimage.zoom(image[first : first + kept, first : first + kept], factor, order=1)
    first = (len(zoomed) - size) // 2
    return zoomed[first : first + size, first : first + size]


@given(st.integers(4, 60), st.floats(1, 5))
def test_a_clipped_zoom_is_scipys_zoom_of_the_centre(size, factor):
    image = np.random.default_rng(0).random((size, size))
    found = clipped_zoom(torch.from_numpy(image)[None, None], factor)[0, 0]
    np.testing.assert_allclose(found, slowly(image, factor), rtol=0, atol=1e-9)


@pytest.mark.parametrize("build", [cifar10_c, imagenet_c])
@pytest.mark.parametrize("severity", [1, 2, 3, 4, 5])
def test_it_is_the_mean_of_the_image_and_its_zooms(build, severity):
    images = np.random.default_rng(0).random((2, 1, 32, 32))
    corruption = build(["zoom_blur"])["zoom_blur"]
    factors = np.arange(1, *corruption.row(severity))
    found = corruption(torch.from_numpy(images), severity, torch.arange(2), 0)
    for (image,), (blurred,) in zip(images, found, strict=True):
        expected = (image + sum(slowly(image, factor) for factor in factors)) / (len(factors) + 1)
        np.testing.assert_allclose(blurred, expected, rtol=0, atol=1e-12)


def test_a_large_image_is_blurred_like_a_small_one_piece_by_piece(monkeypatch):
    images = torch.rand(3, 3, 48, 40)
    corruption = imagenet_c(["zoom_blur"])["zoom_blur"]
    whole = corruption(images, 5, torch.arange(3), 0)
    monkeypatch.setattr("sextant.corruptions.blur.CHUNK", 1)
    torch.testing.assert_close(corruption(images, 5, torch.arange(3), 0), whole, rtol=0, atol=1e-6)
