"""Spatter against one image at a time with scikit-image and OpenCV."""

import cv2
import numpy as np
import pytest
import torch
from skimage.filters import gaussian

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.corruptions.weather import Spatter


def one_image(image, noise, row):
    """Height, width, channels in, and out."""
    mean, spread, sigma, threshold, strength, mud = row
    liquid = gaussian(noise.astype(float) * spread + mean, sigma)
    liquid = np.where(liquid < threshold, 0.0, liquid)
    if mud or image.shape[2] == 1:
        cover = gaussian((liquid > threshold).astype(float), strength)
        cover = np.where(cover < 0.8, 0.0, cover)[..., None]
        brown = np.array([63.0, 42.0, 20.0])[: image.shape[2]] / 255
        return np.clip(image * (1 - cover) + brown * cover, 0, 1)
    levels = (liquid * 255).astype(np.uint8)
    distance = cv2.distanceTransform(cv2.bitwise_not(cv2.Canny(levels, 50, 150)), cv2.DIST_L2, 5)
    _, near = cv2.threshold(distance, 20, 20, cv2.THRESH_TRUNC)
    equal = cv2.equalizeHist(cv2.blur(near, (3, 3)).astype(np.uint8))
    kernel = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], np.float32)
    relief = cv2.blur(cv2.filter2D(equal, cv2.CV_8U, kernel), (3, 3))
    shine = levels.astype(float) * relief
    if shine.max() > 0:
        shine = shine / shine.max()
    return np.clip(image + strength * shine[..., None] * np.array([175.0, 238.0, 238.0]) / 255, 0, 1)


@pytest.mark.parametrize("shape", [(3, 32, 32), (1, 28, 28), (3, 24, 40)])
@pytest.mark.parametrize("which", [cifar10_c, imagenet_c])
def test_a_spattered_image_is_as_one_made_alone(which, shape):
    spatter = which(names=["spatter"])["spatter"]
    clean = torch.rand(4, *shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for level, row in zip(spatter.levels, spatter.table, strict=True):
        noise = spatter.draw(level, torch.arange(4), shape, 0)
        result = spatter.apply(clean, level, noise)
        for i in range(4):
            expected = one_image(clean[i].permute(1, 2, 0).numpy(), noise[i].numpy(), row)
            np.testing.assert_allclose(result[i].permute(1, 2, 0), expected, atol=1e-6)


def test_water_brightens_with_a_turquoise_of_its_full_strength():
    spatter = cifar10_c(names=["spatter"])["spatter"]
    black = torch.zeros(8, 3, 32, 32)
    wet = spatter(black, 2, torch.arange(8), 0)
    torch.testing.assert_close(wet.amax((2, 3)), 0.5 * torch.tensor([175, 238, 238.0]).expand(8, 3) / 255)
    assert 0.01 < (wet[:, 0] > 0).double().mean() < 0.5


def test_mud_covers_with_brown():
    spatter = cifar10_c(names=["spatter"])["spatter"]
    muddy = spatter(torch.ones(16, 3, 32, 32), 5, torch.arange(16), 0)
    covered = (muddy[:, 0] < 0.5).double().mean()
    assert 0.01 < covered < 0.4
    assert muddy.amin((0, 2, 3)).tolist() == pytest.approx(
        [63 / 255, 42 / 255, 20 / 255], abs=0.01
    )  # where the cover is nearly whole


@pytest.mark.parametrize("mud", [0, 1])
def test_an_image_without_a_drop_is_left_as_it_is(mud):
    dry = Spatter(((0.1, 0.01, 1.0, 0.9, 0.5, mud),), "spatter", levels=(1,))
    clean = torch.rand(2, 3, 16, 16)
    torch.testing.assert_close(dry(clean, 1, torch.arange(2), 0), clean)


def test_liquid_beyond_8_bits_overflows_in_faithful_mode_alone():
    row = (1.1, 0.2, 0.7, 0.7, 0.5, 0)
    noise = Spatter((row,), "spatter").draw(1, torch.arange(4), (3, 32, 32), 0)
    black = torch.zeros(4, 3, 32, 32)
    results = [Spatter((row,), "spatter", mode=mode).apply(black, 1, noise) for mode in ("faithful", "corrected")]
    assert not torch.equal(*results)
