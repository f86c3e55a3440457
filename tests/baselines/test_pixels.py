import numpy as np
import pytest

from sextant.baselines import Pixels


def test_cosine_is_the_correlation_coefficient_of_the_images():
    images = np.random.default_rng(0).integers(256, size=(2, 32, 64, 1)).astype(np.uint8)
    first, second = Pixels().describe(images)
    expected = np.corrcoef(images.reshape(2, -1))[0, 1]
    assert first @ second / np.linalg.norm(first) / np.linalg.norm(second) == pytest.approx(expected, abs=1e-5)


def test_mean_is_zero_and_spread_one():
    images = np.random.default_rng(0).integers(256, size=(5, 12, 20, 3)).astype(np.uint8)
    described = Pixels(height=6, width=10).describe(images)
    assert described.shape == (5, 60)
    np.testing.assert_allclose(described.mean(1), 0, atol=1e-5)
    np.testing.assert_allclose(described.std(1), 1, atol=1e-5)


def test_a_flat_image_is_zeros():
    assert not Pixels().describe(np.full((1, 32, 64, 3), 200, np.uint8)).any()
