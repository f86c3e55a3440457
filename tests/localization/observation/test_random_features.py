import pytest
import torch
from localization.observation.battery import GaussianBattery
from localization.observation.smooth_map import KERNEL, poses_in_room, smooth_map

from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.random_features import RandomFeatures, spectral_frequencies
from sextant.localization.pose_kernel import PoseKernel


class TestRandomFeaturesPassTheBattery(GaussianBattery):
    mean_tolerance, nll_tolerance = 0.1, 0.06

    def model(self):
        return RandomFeatures(features=2000)


def kernel_of(spatial: str) -> PoseKernel:
    return PoseKernel(spatial, (1.5, 1.2), 0.9, signal_variance=2.0, noise_variance=0.1)


def kernel_error(kernel: PoseKernel, features: int, seed: int) -> float:
    a, b = poses_in_room(60, seed=1), poses_in_room(60, seed=2)
    model = RandomFeatures(features, seed).fit(smooth_map(20), kernel)
    error = model.features_at(a) @ model.features_at(b).T - kernel(a, b)
    return float(error.square().mean())


@pytest.mark.parametrize("spatial", ["rbf", "matern32", "matern52"])
def test_the_kernels_error_falls_as_one_over_the_root_of_the_features(spatial):
    kernel = kernel_of(spatial)
    few, many = (sum(kernel_error(kernel, size, seed) for seed in range(20)) / 20 for size in (32, 512))
    assert (few / many) ** 0.5 == pytest.approx(4.0, rel=0.15)
    # and in size as Sutherland and Schneider have it: a variance of at most s_f^4 / R for each entry
    assert many < 1.2 * kernel.signal_variance**2 / 512


@pytest.mark.parametrize("spatial", ["rbf", "matern32", "matern52"])
def test_the_frequencies_are_of_the_kernels_spectral_density(spatial):
    """Bochner: the mean of the cosines over very many frequencies is the kernel; 4 standard errors of a cosine."""
    kernel, number = kernel_of(spatial), 200_000
    a, b = poses_in_room(12, seed=1), poses_in_room(12, seed=2)
    a[6:, :2], a[6:, 2] = b[6:, :2] + 0.4, b[6:, 2]  # where the forms of the kernel differ most
    waves = spectral_frequencies(kernel, number, torch.Generator().manual_seed(0))
    circle = [torch.cat([p[:, :2], p[:, 2:].cos(), p[:, 2:].sin()], dim=1) for p in (a, b)]
    mean = ((circle[0] - circle[1]) @ waves).cos().mean(1)
    expected = (kernel(a, b) / kernel.signal_variance).diagonal()
    torch.testing.assert_close(mean, expected, rtol=0, atol=4 * (0.5 / number) ** 0.5)


def test_the_prior_variance_is_exact():
    model = RandomFeatures(10).fit(smooth_map(20), kernel_of("matern32"))
    features = model.features_at(poses_in_room(30, seed=3))
    torch.testing.assert_close(features.square().sum(1), torch.full((30,), 2.0, dtype=torch.float64))


def test_it_is_the_gaussian_process_of_its_own_kernel():
    """Weight space equals function space: the regression is exact for the kernel that the features make."""
    known, poses = smooth_map(60), poses_in_room(20, seed=3)
    model = RandomFeatures(50).fit(known, KERNEL)
    inside, across = model.features_at(known.poses), model.features_at(poses)
    noisy = inside @ inside.T + KERNEL.noise_variance * torch.eye(60, dtype=torch.float64)
    gain = torch.linalg.solve(noisy, inside @ across.T).T
    mean = known.mean + gain @ (known.descriptors - known.mean).double()
    variance = KERNEL.signal_variance - (gain * (across @ inside.T)).sum(1) + KERNEL.noise_variance
    torch.testing.assert_close(model.predict(poses).mean, mean)
    torch.testing.assert_close(model.predict(poses).variance, variance)


@pytest.mark.slow
def test_it_tends_to_the_exact_process():
    known, poses = smooth_map(), poses_in_room(100, seed=1)
    wanted = ExactGP().fit(known, KERNEL).predict(poses).mean
    errors = [
        float((RandomFeatures(size).fit(known, KERNEL).predict(poses).mean - wanted).square().mean().sqrt())
        for size in (64, 512, 4096)
    ]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
