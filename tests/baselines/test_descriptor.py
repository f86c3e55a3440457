"""What holds of every training-free descriptor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.baselines import Hog, PatchNormalised, Pixels, WhitenedPCA, place_descriptors

KINDS = {
    "pixels": (Pixels(), 2048),
    "patch_normalised": (PatchNormalised(), 2048),
    "hog": (Hog(), 256),
    "whitened_pca": (WhitenedPCA(dimensions=16), 16),
}


def noise(*shape, seed=0):
    return np.random.default_rng(seed).integers(40, 200, size=shape).astype(np.uint8)


@pytest.fixture(scope="module", params=KINDS)
def kind(request):
    """A fitted descriptor and its length."""
    fitted, length = KINDS[request.param]
    return fitted.fit(noise(64, 32, 64, 3, seed=1)), length


def test_one_finite_row_for_each_image_of_any_size(kind):
    fitted, length = kind
    for shape in ((5, 32, 64, 3), (3, 48, 100, 3), (2, 20, 30, 1)):
        described = fitted.describe(noise(*shape))
        assert described.shape == (shape[0], length)
        assert described.dtype == np.float32
        assert np.isfinite(described).all()


def test_chunks_change_nothing(kind, monkeypatch):
    fitted, _ = kind
    images = noise(7, 32, 64, 3)
    whole = fitted.describe(images)
    monkeypatch.setattr(place_descriptors, "CHUNK", 3)
    np.testing.assert_allclose(fitted.describe(images), whole, atol=1e-5)


@given(gain=st.floats(0.5, 1.2), offset=st.integers(-15, 15))
def test_gain_and_offset_of_the_light_hardly_matter(kind, gain, offset):
    fitted, _ = kind
    images = noise(4, 32, 64, 3)
    lit = np.clip(np.rint(images * gain + offset), 0, 255).astype(np.uint8)
    first, second = (place_descriptors.unit_norm(fitted.describe(each)) for each in (images, lit))
    assert (first * second).sum(1).min() > 0.99


def test_flat_images_are_described_without_nan(kind):
    fitted, _ = kind
    assert np.isfinite(fitted.describe(np.full((2, 32, 64, 3), 7, np.uint8))).all()


def test_an_image_has_a_descriptor_whatever_stands_beside_it(kind):
    fitted, _ = kind
    images = noise(6, 32, 64, 3)
    np.testing.assert_allclose(fitted.describe(images[2:3]), fitted.describe(images)[2:3], atol=1e-5)


def test_no_image_is_refused(kind):
    with pytest.raises(ValueError, match="need uint8 images"):
        kind[0].describe(np.zeros((0, 32, 64, 3), np.uint8))


def test_rows_of_zeros_stay_zeros():
    rows = np.array([[3, 4], [0, 0]], np.float32)
    np.testing.assert_allclose(place_descriptors.unit_norm(rows), [[0.6, 0.8], [0, 0]])
