import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

from sextant.baselines import Pixels, WhitenedPCA
from sextant.baselines.place_descriptors import unit_norm
from sextant.chapters.places.descriptors import BaselineDescriber


@pytest.fixture
def images():
    """Smooth random images, whose components differ in variance."""
    rng = np.random.default_rng(0)
    coarse = rng.normal(size=(90, 4, 8)).repeat(8, 1).repeat(8, 2) + 0.3 * rng.normal(size=(90, 32, 64))
    return np.clip(127 + 40 * coarse, 0, 255).astype(np.uint8)[..., None]


def test_it_is_the_singular_value_decomposition_of_the_centred_pixels(images):
    pixels = Pixels().describe(images).astype(float)
    u, _, _ = np.linalg.svd(pixels - pixels.mean(0), full_matrices=False)
    expected = unit_norm(u[:, :10].astype(np.float32))
    described = WhitenedPCA(dimensions=10).fit(images).describe(images)
    np.testing.assert_allclose(described @ described.T, expected @ expected.T, atol=1e-3)  # signs are free


def test_rows_have_norm_one(images):
    described = WhitenedPCA(dimensions=12).fit(images[:60]).describe(images[60:])
    np.testing.assert_allclose(np.linalg.norm(described, axis=1), 1, atol=1e-5)


def test_it_is_learnt_from_the_reference_alone(images):
    fitted = WhitenedPCA(dimensions=12).fit(images[:60])
    before = fitted.describe(images[:5])
    fitted.describe(255 - images)
    assert np.array_equal(fitted.describe(images[:5]), before)


def test_a_long_reference_is_thinned_evenly(images):
    thinned = WhitenedPCA(dimensions=12, most_images=45).fit(images)
    by_hand = WhitenedPCA(dimensions=12).fit(images[::2])
    assert np.array_equal(thinned.describe(images), by_hand.describe(images))


def test_few_images_give_as_many_dimensions_as_they_span(images):
    assert WhitenedPCA(dimensions=90).fit(images).describe(images).shape == (90, 89)
    few = WhitenedPCA(dimensions=20).fit(np.tile(images[:8], (5, 1, 1, 1)))
    asked_for = WhitenedPCA(dimensions=7).fit(np.tile(images[:8], (5, 1, 1, 1)))
    np.testing.assert_allclose(few.describe(images[:8]), asked_for.describe(images[:8]), atol=1e-5)


def test_one_image_is_refused(images):
    with pytest.raises(ValueError, match="at least two reference images"):
        WhitenedPCA().fit(images[:1])


def test_it_must_be_fitted_first(images):
    with pytest.raises(NotFittedError, match="fit was not called"):
        WhitenedPCA().describe(images)


@pytest.mark.parametrize(("most", "shown"), [(10_000, 10_000), (11_000, 11_000), (10, 10_000), (20_000, 12_000)])
def test_of_a_large_map_as_many_images_are_shown_as_it_asks_for(most, shown):
    class Counting(WhitenedPCA):
        def fit(self, images):
            self.shown = images[:, 0, 0, 0]

    descriptor = Counting(most_images=most)
    BaselineDescriber(descriptor, "counting").fit(np.arange(12_000).reshape(-1, 1, 1, 1))
    assert len(np.unique(descriptor.shown)) == shown
