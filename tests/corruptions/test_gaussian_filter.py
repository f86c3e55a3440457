import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from sextant.corruptions import imagenet_c
from sextant.corruptions.filtering import gaussian_filter, gaussian_matrix, gaussian_weights


@given(
    height=st.integers(1, 30),
    width=st.integers(1, 30),
    sigma=st.floats(0.01, 8),
    border=st.sampled_from(["nearest", "reflect", "mirror"]),
    truncate=st.sampled_from([3.0, 4.0]),
)
def test_it_is_scipys_filter(height, width, sigma, border, truncate):
    image = np.random.default_rng(0).random((2, 3, height, width))
    expected = ndimage.gaussian_filter(image, (0, 0, sigma, sigma), mode=border, truncate=truncate)
    found = gaussian_filter(torch.from_numpy(image), sigma, border, truncate)
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=1e-12)


def test_axes_are_smoothed_on_their_own():
    image = np.random.default_rng(0).random((9, 12))
    for sigma in ((1.3, 0.0), (0.0, 0.7), (2.0, 0.5)):
        found = gaussian_filter(torch.from_numpy(image)[None, None], sigma)[0, 0]
        np.testing.assert_allclose(found, ndimage.gaussian_filter(image, sigma, mode="nearest"), atol=1e-12)


@given(st.floats(0.01, 20), st.integers(1, 60), st.sampled_from(["nearest", "reflect", "mirror"]))
def test_weights_sum_to_one(sigma, size, border):
    assert gaussian_weights(sigma, int(4 * sigma + 0.5)).sum().item() == pytest.approx(1)
    torch.testing.assert_close(gaussian_matrix(size, sigma, border).sum(1), torch.ones(size, dtype=torch.float64))


def test_gaussian_blur_is_that_filter_with_edges_repeated():
    image = np.random.default_rng(0).random((2, 3, 40, 50))
    for severity, sigma in enumerate((1, 2, 3, 4, 6), 1):
        found = imagenet_c(["gaussian_blur"])["gaussian_blur"](torch.from_numpy(image), severity, torch.arange(2), 0)
        np.testing.assert_allclose(
            found, ndimage.gaussian_filter(image, (0, 0, sigma, sigma), mode="nearest"), atol=1e-12
        )
