import math

import pytest
import torch
from scipy import stats

from sextant.corruptions import GaussianNoise

INDICES = torch.arange(20)
SHAPE = (3, 32, 32)
VALUES = 20 * 3 * 32 * 32


@pytest.mark.parametrize("variance", [0.01, 0.1, 0.5])
def test_the_noise_is_normal_with_the_stated_variance(variance):
    noise = GaussianNoise([variance]).draw(variance, INDICES, SHAPE, 0).flatten().double()
    assert abs(noise.mean()) < 4 * math.sqrt(variance / VALUES)
    assert abs(noise.var() / variance - 1) < 4 * math.sqrt(2 / VALUES)
    assert stats.kstest(noise.numpy() / math.sqrt(variance), "norm").pvalue > 0.001


def test_the_noise_is_added_whatever_the_image():
    corruption = GaussianNoise([0.1])
    black, white = torch.zeros(20, *SHAPE), torch.ones(20, *SHAPE)
    noise = corruption.draw(0.1, INDICES, SHAPE, 0)
    assert torch.equal(corruption(black, 0.1, INDICES, 0), noise)
    assert torch.equal(corruption(white, 0.1, INDICES, 0), 1 + noise)


def test_noise_of_other_levels_seeds_images_and_names_is_uncorrelated():
    def standard(level=0.1, first=0, seed=0, name="gaussian"):
        return GaussianNoise([level], name=name).draw(level, INDICES + first, SHAPE, seed).flatten() / math.sqrt(level)

    draws = torch.stack([standard(), standard(level=0.2), standard(first=20), standard(seed=1), standard(name="other")])
    correlation = torch.corrcoef(draws).fill_diagonal_(0)
    assert correlation.abs().max() < 4.5 / math.sqrt(VALUES)


def test_no_variance_is_no_noise():
    images = torch.rand(20, *SHAPE)
    assert torch.equal(GaussianNoise([0.0])(images, 0.0, INDICES, 0), images)
