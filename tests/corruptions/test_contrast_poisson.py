import math

import pytest
import torch

from sextant.corruptions import ContrastPoisson

INDICES = torch.arange(10)
PIXELS = 10 * 64 * 64


def corrupted(grey, contrast, peak=256.0):
    corruption = ContrastPoisson([contrast], peak=peak)
    return corruption(torch.full((10, 1, 64, 64), grey, dtype=torch.float64), contrast, INDICES, 0)


@pytest.mark.parametrize("peak", [20.0, 256.0])
@pytest.mark.parametrize("contrast", [1.0, 0.5, 0.2])
@pytest.mark.parametrize("grey", [0.05, 0.5, 1.0])
def test_the_mean_is_the_flattened_image_and_the_variance_that_of_counted_photons(grey, contrast, peak):
    flat = (grey - 0.5) * contrast + 0.5
    noisy, rate = corrupted(grey, contrast, peak), flat * peak
    assert abs(noisy.mean() - flat) < 4 * math.sqrt(flat / peak / PIXELS)
    assert abs(noisy.var() - flat / peak) < 4 * math.sqrt((rate + 2 * rate**2) / PIXELS) / peak**2


def test_values_are_whole_counts_of_photons():
    counts = corrupted(0.3, 0.5, peak=100.0) * 100
    torch.testing.assert_close(counts, counts.round(), rtol=0, atol=1e-9)


def test_black_at_full_contrast_has_no_photons_to_count():
    assert not corrupted(0.0, 1.0).any()


def test_a_coloured_image_is_flattened_channel_by_channel():
    image = torch.tensor([0.0, 0.5, 1.0]).view(1, 3, 1, 1).expand(1, 3, 64, 64)
    noisy = ContrastPoisson([0.4], peak=1e6)(image, 0.4, torch.tensor([0]), 0)
    torch.testing.assert_close(noisy.mean((0, 2, 3)), torch.tensor([0.3, 0.5, 0.7]), rtol=0, atol=1e-3)
