"""Moments of the noise families: within 2 % of their formulas, away from black and white where nothing is clipped."""

import math

import pytest
import torch
from scipy import stats

from sextant.corruptions import cifar10_c, imagenet_c

INDICES = torch.arange(80)
SEVERITIES = [1, 2, 3, 4, 5]


def noise(name, severity, grey, build=cifar10_c):
    images = torch.full((80, 3, 32, 32), grey)
    return (build([name])[name](images, severity, INDICES, 0) - grey).double()


@pytest.mark.parametrize(("severity", "sigma"), list(zip(SEVERITIES, (0.04, 0.06, 0.08, 0.09, 0.10), strict=True)))
def test_gaussian_noise_has_the_published_spread(severity, sigma):
    found = noise("gaussian_noise", severity, 0.5)
    assert found.std() == pytest.approx(sigma, rel=0.02)
    assert abs(found.mean()) < 5 * sigma / math.sqrt(found.numel())
    assert stats.kstest(found.flatten()[::10].numpy() / sigma, "norm").pvalue > 0.001


@pytest.mark.parametrize(("severity", "sigma"), list(zip(SEVERITIES, (0.06, 0.1, 0.12, 0.16, 0.2), strict=True)))
@pytest.mark.parametrize("grey", [0.25, 0.5])
def test_speckle_noise_is_in_proportion_to_the_image(severity, sigma, grey):
    found = noise("speckle_noise", severity, grey)
    assert found.std() == pytest.approx(sigma * grey, rel=0.02)
    assert abs(found.mean()) < 5 * sigma * grey / math.sqrt(found.numel())


@pytest.mark.parametrize(("severity", "peak"), list(zip(SEVERITIES, (500, 250, 100, 75, 50), strict=True)))
@pytest.mark.parametrize("grey", [0.1, 0.4])
def test_shot_noise_has_the_variance_of_counted_photons(severity, peak, grey):
    found = noise("shot_noise", severity, grey)
    assert found.var() == pytest.approx(grey / peak, rel=0.02)
    assert abs(found.mean()) < 5 * math.sqrt(grey / peak / found.numel())
    counts = (found + grey) * peak
    torch.testing.assert_close(counts, counts.round(), rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("build", "amounts"),
    [(cifar10_c, (0.01, 0.02, 0.03, 0.05, 0.07)), (imagenet_c, (0.03, 0.06, 0.09, 0.17, 0.27))],
)
@pytest.mark.parametrize("severity", SEVERITIES)
def test_impulse_noise_makes_equal_shares_black_and_white_and_leaves_the_rest(build, amounts, severity):
    found, amount = noise("impulse_noise", severity, 0.25, build), amounts[severity - 1]
    black, white, kept = ((found == value).double().mean() for value in (-0.25, 0.75, 0))
    spread = 4.5 / math.sqrt(found.numel())
    assert abs(black - amount / 2) < spread * math.sqrt(amount / 2)
    assert abs(white - amount / 2) < spread * math.sqrt(amount / 2)
    assert black + white + kept == pytest.approx(1)


def test_impulses_of_the_channels_of_a_pixel_are_independent():
    hit = (noise("impulse_noise", 5, 0.25, imagenet_c) != 0).double()
    together = torch.corrcoef(hit.transpose(0, 1).flatten(1)) - torch.eye(3)
    assert together.abs().max() < 0.02


def test_noise_of_the_severities_is_not_one_pattern_at_several_strengths():
    patterns = torch.stack([noise("gaussian_noise", s, 0.5).flatten() for s in SEVERITIES])
    assert (torch.corrcoef(patterns) - torch.eye(5)).abs().max() < 0.02


def test_black_stays_black_under_speckle_and_shot_noise():
    for name in ("speckle_noise", "shot_noise"):
        assert not noise(name, 5, 0.0).any()
