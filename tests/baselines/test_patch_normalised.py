import numpy as np
import pytest

from sextant.baselines import PatchNormalised


def test_every_patch_has_mean_zero_and_spread_one():
    images = np.random.default_rng(0).integers(256, size=(3, 32, 64, 3)).astype(np.uint8)
    patches = PatchNormalised().describe(images).reshape(3, 32, 64)
    np.testing.assert_allclose(patches.mean(2), 0, atol=1e-5)
    np.testing.assert_allclose(patches.std(2), 1, atol=1e-5)


def test_light_that_differs_from_patch_to_patch_does_not_matter():
    images = np.random.default_rng(0).integers(80, size=(1, 32, 64, 1)).astype(np.uint8)
    offsets = np.random.default_rng(1).integers(150, size=(4, 8)).astype(np.uint8).repeat(8, 0).repeat(8, 1)
    described = PatchNormalised().describe(np.concatenate([images, images + offsets[None, :, :, None]]))
    np.testing.assert_allclose(described[0], described[1], atol=1e-4)


def test_patches_are_squares_of_the_image():
    images = np.zeros((1, 16, 24, 1), np.uint8)
    images[0, 8:, 16:, 0] = np.arange(64).reshape(8, 8)
    described = PatchNormalised(height=16, width=24).describe(images).reshape(6, 64)
    assert np.flatnonzero(described.any(1)).tolist() == [5]
    assert (np.diff(described[5]) > 0).all()


@pytest.mark.parametrize(("height", "width", "patch"), [(30, 64, 8), (32, 60, 8), (32, 64, 1)])
def test_patches_that_do_not_tile_the_image_are_refused(height, width, patch):
    with pytest.raises(ValueError, match=f"patch={patch} must be at least 2 and divide"):
        PatchNormalised(height, width, patch).describe(np.zeros((1, 32, 64, 3), np.uint8))
