"""Snow against one image at a time with scipy and loops."""

import math

import numpy as np
import pytest
import torch
from scipy import ndimage

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.corruptions.pixels import luma
from sextant.corruptions.weather import Snow


def blown(layer, radius, sigma, degrees):
    """Shifted copies of the padded layer, one after the other."""
    weights = [math.exp(-(i**2) / (2 * sigma**2)) for i in range(2 * math.ceil(radius) + 1)]
    height, width = layer.shape
    far = len(weights)
    padded, out = np.pad(layer, far, mode="edge"), np.zeros_like(layer)
    for i, weight in enumerate(weights):
        dx = math.ceil(i * math.cos(math.radians(degrees)) - 0.5)
        dy = math.ceil(i * math.sin(math.radians(degrees)) - 0.5)
        out += weight * padded[far + dy : far + dy + height, far + dx : far + dx + width]
    return out / sum(weights)


def one_image(image, noise, degrees, row, mode):
    mean, spread, zoom, threshold, radius, sigma, mix = row
    height, width = noise.shape
    layer = noise.astype(float) * spread + mean
    kept = [math.ceil(side / zoom) for side in (height, width)]
    top, left = (height - kept[0]) // 2, (width - kept[1]) // 2
    layer = ndimage.zoom(layer[top : top + kept[0], left : left + kept[1]], zoom, order=1)
    top, left = (layer.shape[0] - height) // 2, (layer.shape[1] - width) // 2
    layer = layer[top : top + height, left : left + width].copy()
    layer[layer < threshold] = 0
    layer = layer.clip(0, 1)
    if mode == "faithful":
        layer = np.floor(layer * 255) / 255
    layer = blown(layer, radius, sigma, degrees)
    if mode == "faithful":
        layer = np.round(layer * 255) / 255
    grey = image[0] * 0.299 + image[1] * 0.587 + image[2] * 0.114 if len(image) == 3 else image[0]
    whiter = mix * image + (1 - mix) * np.maximum(image, 1.5 * grey + 0.5)
    return np.clip(whiter + layer + np.rot90(layer, 2), 0, 1)


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
@pytest.mark.parametrize("shape", [(3, 32, 32), (1, 28, 28), (3, 24, 40)])
@pytest.mark.parametrize("which", [cifar10_c, imagenet_c])
def test_a_snowy_image_is_as_one_made_alone(which, mode, shape):
    snow = which(names=["snow"], mode=mode)["snow"]
    clean = torch.rand(2, *shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for level, row in zip(snow.levels, snow.table, strict=True):
        draw = snow.draw(level, torch.arange(2), shape, 0)
        result = snow.apply(clean, level, draw)
        for i in range(2):
            expected = one_image(clean[i].numpy(), draw.noise[i].numpy(), float(draw.angles[i]), row, mode)
            off = np.abs(result[i].numpy() - expected)
            assert np.mean(off > 1e-6) < 0.01  # a flake on the edge between two grey levels
            assert off.max() < 2.1 / 255


def test_the_wind_blows_evenly_over_a_quarter_turn():
    snow = cifar10_c(names=["snow"])["snow"]
    angles = snow.draw(1, torch.arange(400), (3, 4, 4), 0).angles
    assert -135 <= angles.min() < -130
    assert -50 < angles.max() <= -45
    assert abs(angles.mean() + 90) < 4 * 90 / math.sqrt(12 * 400)


def test_snow_whitens():
    snow = cifar10_c(names=["snow"])["snow"]
    clean = torch.rand(32, 3, 32, 32, generator=torch.Generator().manual_seed(0)) * 0.5
    assert all(bool((snow(clean, level, torch.arange(32), 0) >= clean - 1e-6).all()) for level in snow.levels)
    means = [snow(clean, level, torch.arange(32), 0).mean().item() for level in snow.levels]
    assert means[0] > clean.mean() + 0.02
    assert means == sorted(means)


def test_above_every_flake_no_snow_falls():
    calm = Snow(((0.0, 0.1, 1.0, 50.0, 8.0, 3.0, 1.0),), "snow", levels=(1,))
    clean = torch.rand(2, 3, 16, 16)
    torch.testing.assert_close(calm(clean, 1, torch.arange(2), 0), clean)


def test_luma_weighs_the_channels():
    assert luma(torch.eye(3).reshape(3, 3, 1, 1)).flatten().tolist() == pytest.approx([0.299, 0.587, 0.114])
    grey = torch.rand(2, 1, 4, 4)
    assert torch.equal(luma(grey), grey)
    with pytest.raises(ValueError, match="1 or 3 channels"):
        luma(torch.rand(1, 4, 2, 2))
