"""How far each severity takes an image: growing where the published parameters grow, pinned where they do not."""

import numpy as np
import pytest
import torch
from scipy import ndimage

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.data.cifar10 import CIFAR10

GROWING = [
    "gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise", "defocus_blur", "gaussian_blur", "zoom_blur",
    "brightness", "contrast", "pixelate", "jpeg_compression",
]  # fmt: skip
#: Severities from the mildest to the strongest, where their numbers do not say so.
CIFAR_ORDER = {"elastic_transform": (5, 4, 3, 2, 1), "saturate": (3, 1, 2, 4, 5)}


def smooth_images(count=48, size=32):
    """Images with the spectrum of photographs, in colour, in [0, 1]."""
    rng = np.random.default_rng(0)

    def detail(channels, cells):
        noise = rng.normal(size=(count, channels, cells, cells))
        return ndimage.zoom(noise, (1, 1, size / cells, size / cells), order=1)

    grey, tint = sum(detail(1, cells) for cells in (2, 4, 8, 16, 32)), detail(3, 4)
    return torch.from_numpy(np.clip(0.5 + 0.12 * grey + 0.06 * tint, 0, 1)).float()


def errors(corruption, images):
    indices = torch.arange(len(images))
    return [(corruption(images, s, indices, 0) - images).square().mean().item() for s in (1, 2, 3, 4, 5)]


@pytest.mark.parametrize("name", GROWING)
@pytest.mark.parametrize("build", [cifar10_c, imagenet_c])
@pytest.mark.parametrize("mode", ["faithful", "corrected"])
def test_the_mean_square_error_grows_with_the_severity(name, build, mode):
    found = errors(build([name], mode=mode)[name], smooth_images())
    assert found == sorted(found)
    assert len(set(found)) == 5


@pytest.mark.real_data
@pytest.mark.parametrize("name", GROWING)
def test_it_grows_on_photographs(name, real_data):
    found = errors(cifar10_c([name])[name], photographs(real_data))
    assert found == sorted(found)


def order(corruption, images):
    return tuple(int(i) + 1 for i in np.argsort(errors(corruption, images)))


@pytest.mark.parametrize("name", sorted(CIFAR_ORDER))
def test_elastic_transform_and_saturation_have_an_order_of_their_own(name):
    assert order(cifar10_c([name])[name], smooth_images()) == CIFAR_ORDER[name]


@pytest.mark.real_data
@pytest.mark.parametrize("name", sorted(CIFAR_ORDER))
def test_they_have_it_on_photographs_too(name, real_data):
    assert order(cifar10_c([name])[name], photographs(real_data)) == CIFAR_ORDER[name]


def photographs(folder):
    return torch.from_numpy(CIFAR10([folder]).read("test").images[:256]).float() / 255
