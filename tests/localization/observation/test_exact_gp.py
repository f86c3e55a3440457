import numpy as np
import pytest
import torch
from localization.observation.battery import GaussianBattery
from localization.observation.smooth_map import KERNEL, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.pose_kernel import PoseKernel


class TestExactGPPassesTheBattery(GaussianBattery):
    mean_tolerance = nll_tolerance = 0.0

    def model(self):
        return ExactGP()


def test_predictions_are_those_of_the_textbook_with_an_explicit_inverse():
    known, poses = smooth_map(40), poses_in_room(15, seed=1)
    inverse = np.linalg.inv(KERNEL(known.poses, known.poses).numpy() + KERNEL.noise_variance * np.eye(40))
    across = KERNEL(poses, known.poses).numpy()
    centred = known.descriptors.double().numpy() - known.mean.double().numpy()
    predicted = ExactGP().fit(known, KERNEL).predict(poses)
    np.testing.assert_allclose(predicted.mean, known.mean.numpy() + across @ inverse @ centred, atol=1e-6)
    explained = np.einsum("ij,jk,ik->i", across, inverse, across)
    expected = KERNEL.signal_variance - explained + KERNEL.noise_variance
    np.testing.assert_allclose(predicted.variance, expected, atol=1e-12)


def test_without_noise_it_passes_through_the_map():
    kernel = PoseKernel("matern32", (1.5, 1.2), 0.9, signal_variance=1.0, noise_variance=0.0)
    known = smooth_map(50)
    predicted = ExactGP().fit(known, kernel).predict(known.poses)
    torch.testing.assert_close(predicted.mean.float(), known.descriptors, rtol=0, atol=1e-5)
    assert predicted.variance.max() < 1e-9
    assert predicted.variance.min() > 0


def test_far_from_the_map_it_falls_back_to_the_mean_and_the_prior_variance():
    known = smooth_map(50)
    predicted = ExactGP().fit(known, KERNEL).predict(torch.full((1, 3), 1e3, dtype=torch.float64))
    torch.testing.assert_close(predicted.mean[0].float(), known.mean)
    assert predicted.variance.item() == pytest.approx(KERNEL.signal_variance + KERNEL.noise_variance)


def test_images_of_its_own_prior_fall_into_their_intervals():
    """A sample of the process itself: 95 % of unseen values within 1.96 deviations, mean normalised square of one."""
    known, unseen = poses_in_room(200, seed=3), poses_in_room(400, seed=4)
    everywhere = torch.cat([known, unseen])
    factor = torch.linalg.cholesky(KERNEL(everywhere, everywhere) + 1e-9 * torch.eye(600, dtype=torch.float64))
    draws = torch.randn(2, 600, 100, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
    images = (factor @ draws[0] + KERNEL.noise_variance**0.5 * draws[1]).float()
    map_of_draws = DescriptorMap(known, images[:200].contiguous(), torch.zeros(100))
    predicted = ExactGP().fit(map_of_draws, KERNEL).predict(unseen)
    normalised = (images[200:] - predicted.mean) / predicted.variance.sqrt()[:, None]
    assert normalised.square().mean().item() == pytest.approx(1.0, abs=0.02)
    assert (normalised.abs() < 1.96).double().mean().item() == pytest.approx(0.95, abs=0.01)


def test_poses_that_nearly_coincide_without_noise_are_refused_with_the_key():
    poses = torch.tensor([[0.0, 0.0, 0.0], [1e-12, 0.0, 0.0]], dtype=torch.float64)
    known = DescriptorMap.of(poses, torch.tensor([[0.0], [1.0]]))
    with pytest.raises(UserError, match=r"kernel\.noise_variance=0"):
        ExactGP().fit(known, PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.0))


def test_a_map_too_large_is_refused_before_memory_is_taken():
    with pytest.raises(UserError, match=r"240 images.*max_images=100"):
        ExactGP(max_images=100).fit(smooth_map(), KERNEL)
