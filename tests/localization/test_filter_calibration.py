"""Maps and images drawn from the prior itself: the posterior of a filter of that very prior is as sure as it is right.

Of the exact posterior, whatever its shape, the mean NEES over draws of everything is its degrees of freedom; and where
it is nearly Gaussian, as with a start narrower than the kernel's lengths, its 95 % region holds the truth 95 % of the
time. Worlds are drawn with formulas of their own: of the library only the covariance function and the motions are used.
"""

import functools
import math

import numpy as np
import pytest
import torch
from localization.moments import mean_over_all
from scipy import stats

from sextant.evaluation.pose_posterior import nees, posterior_calibration
from sextant.geometry.planar import se2_compose, se2_exp
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.initialisation import GaussianStart
from sextant.localization.likelihood import Likelihood
from sextant.localization.map_prior import MapPrior
from sextant.localization.motion import ExponentialMotion
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.particle_filter import ParticleFilter
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.recovery import NoRecovery
from sextant.localization.resampling import SystematicResampling

KERNEL = PoseKernel("rbf", (1.2, 1.0), 0.9, 1.0, 0.05)
#: with fewer particles than 2,000 their own error would show
MAP, DIMENSION, PARTICLES, WORLDS = 80, 3, 2000, 200
START_SIGMA, STEP_SIGMA = (0.25, 0.25, 0.2), (0.05, 0.04, 0.05)
MOVED = torch.tensor([[0.15, 0.0, 0.1]], dtype=torch.float64)


def map_poses(generator):
    uniform = torch.rand(MAP, 3, dtype=torch.float64, generator=generator)
    return (uniform - 0.5) * torch.tensor([3.0, 3.0, 2 * math.pi], dtype=torch.float64)


def drawn_way(frames, generator):
    """A way from about the middle of the room, by the filter's model of the start and of motion."""
    sigmas = [torch.tensor([sigma], dtype=torch.float64) for sigma in (START_SIGMA, STEP_SIGMA)]
    way = [sigmas[0] * torch.randn(1, 3, dtype=torch.float64, generator=generator)]
    for _ in range(frames - 1):
        noise = sigmas[1] * torch.randn(1, 3, dtype=torch.float64, generator=generator)
        way.append(se2_compose(se2_compose(way[-1], MOVED), se2_exp(noise)))
    return torch.cat(way)


def drawn_images(poses, way, generator, together):
    """Descriptors of the map and of the frames of a way by the prior: of both together, or of each frame given the map.

    A filter takes frames for independent given the map; together, they share what the map does not know of its places.
    """

    def normal(*shape):
        return torch.randn(*shape, dtype=torch.float64, generator=generator).numpy()

    everywhere = torch.cat([poses, way])
    covariance = KERNEL(everywhere, everywhere).numpy() + KERNEL.noise_variance * np.eye(len(everywhere))
    if together:
        drawn = np.linalg.cholesky(covariance) @ normal(len(everywhere), DIMENSION)
        return drawn[:MAP], drawn[MAP:]
    among, between = covariance[:MAP, :MAP], covariance[:MAP, MAP:]
    mapped = np.linalg.cholesky(among) @ normal(MAP, DIMENSION)
    across = np.linalg.solve(among, between)  # (map, frames)
    left = covariance.diagonal()[MAP:] - (across * between).sum(0)
    return mapped, across.T @ mapped + np.sqrt(left)[:, None] * normal(len(way), DIMENSION)


def told(seed, frames, believed, together):
    """Truth, mean and covariance of a filter after the last frame, in a world of its own; it believes in a kernel."""
    generator = torch.Generator().manual_seed(seed)
    poses = map_poses(generator)
    way = drawn_way(frames, generator)
    mapped, seen = (torch.from_numpy(each).float() for each in drawn_images(poses, way, generator, together))
    model = ExactGP().fit(DescriptorMap(poses, mapped, torch.zeros(DIMENSION)), believed)
    prior = MapPrior(poses, 0.1, 0.1)
    filter = ParticleFilter(ExponentialMotion(STEP_SIGMA), SystematicResampling(), NoRecovery(), prior)
    start = GaussianStart(torch.zeros(1, 3, dtype=torch.float64), START_SIGMA)
    state = filter.start(start, 1, PARTICLES, generator)
    for frame in range(frames):
        evidence = model.observe(seen[frame : frame + 1], Likelihood())
        state, _ = filter.step(state, MOVED if frame else None, evidence, None, generator)
    pose, covariance = mean_over_all(state.belief)
    return way[-1].numpy(), pose[0].numpy(), covariance[0].numpy()


@functools.cache
def errors(frames, noise_factor, together=False, worlds=WORLDS):
    """The NEES of many worlds; the filter takes the noise of images for so many times what it is."""
    kernel = PoseKernel("rbf", KERNEL.length, 0.9, 1.0, noise_factor * KERNEL.noise_variance)
    found = [told(seed, frames, kernel, together) for seed in range(worlds)]
    return nees(*(np.stack(each) for each in zip(*found, strict=True)))


def held_within(level):
    """How many of the worlds' 95 % regions hold the truth, if each does so with that chance."""
    return stats.binom.interval(level, WORLDS, 0.95)


@pytest.mark.slow
@pytest.mark.parametrize(("frames", "together"), [(1, True), (3, False)])
def test_the_posterior_is_as_sure_as_it_is_right(frames, together):
    values = errors(frames, 1.0, together)
    found = posterior_calibration(values, 3, confidence=0.99)
    assert found.low <= found.mean <= found.high, found
    few, many = held_within(0.99)
    assert few <= (values <= stats.chi2.ppf(0.95, 3)).sum() <= many


@pytest.mark.slow
def test_too_little_noise_is_found_out():
    values = errors(3, 0.25, worlds=WORLDS // 4)  # the effect is large
    found = posterior_calibration(values, 3, confidence=0.9999)
    assert found.mean > 2 * found.high
    assert (values <= stats.chi2.ppf(0.95, 3)).mean() < 0.7


@pytest.mark.slow
def test_too_much_noise_is_found_out():
    """A filter that is too unsure shows less than one that is too sure: it takes twice the worlds."""
    values = errors(3, 4.0, worlds=2 * WORLDS)
    found = posterior_calibration(values, 3, confidence=0.99)
    assert found.mean < found.low
    assert (values <= stats.chi2.ppf(0.95, 3)).mean() > 0.95


@pytest.mark.slow
def test_frames_that_share_what_a_thin_map_does_not_know_make_a_filter_too_sure():
    """What tempering is for, beside the change of appearance: of 80 images in nine square metres, NEES 4.3, 86 %."""
    values = errors(3, 1.0, True)
    found = posterior_calibration(values, 3, confidence=0.9999)
    assert found.mean > found.high
    assert (values <= stats.chi2.ppf(0.95, 3)).mean() < 0.92
