import numpy as np
import pytest
import torch
from localization.observation.battery import GaussianBattery
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.observation._pose_grid import PoseGrid
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.ski import SKI
from sextant.localization.pose_kernel import PoseKernel


class TestSKIPassesTheBattery(GaussianBattery):
    mean_tolerance, nll_tolerance = 0.03, 0.02

    def model(self):
        return SKI(spacing=0.5)


def on_a_street(count=150):
    poses = torch.zeros(count, 3, dtype=torch.float64)
    poses[:, 0] = torch.arange(count) * 0.2 + 1e6
    poses[:, 1:] = torch.tensor([7.0, 3.0])
    return DescriptorMap.of(poses, descriptors_at(poses - torch.tensor([1e6, 0, 0]), 6))


@pytest.mark.slow
def test_it_is_the_gaussian_process_of_its_interpolated_kernel():
    """Conjugate gradients and a Lanczos root of full rank against dense matrices."""
    known, poses = smooth_map(60), poses_in_room(20, seed=1)
    model = SKI(spacing=0.7, rank=60).fit(known, KERNEL)
    grid = PoseGrid.of(known.poses, KERNEL, 0.7)
    inside, across = (torch.from_numpy(grid.interpolation(some)[0].toarray()) for some in (known.poses, poses))
    covariance = torch.from_numpy(grid.times_kernel(torch.eye(grid.nodes, dtype=torch.float64).numpy()))
    noisy = inside @ covariance @ inside.T + KERNEL.noise_variance * torch.eye(60, dtype=torch.float64)
    gain = torch.linalg.solve(noisy, inside @ covariance @ across.T).T
    mean = known.mean + gain @ (known.descriptors - known.mean).double()
    left = (across @ covariance @ across.T).diagonal() - (gain * (across @ covariance @ inside.T)).sum(1)
    torch.testing.assert_close(model.predict(poses).mean, mean, rtol=0, atol=1e-4)
    torch.testing.assert_close(model.predict(poses).variance, left + KERNEL.noise_variance, rtol=1e-3, atol=1e-4)


def test_the_kernel_on_the_grid_is_that_of_the_nodes_poses():
    grid = PoseGrid.of(poses_in_room(30), KERNEL, 1.0)
    axes = [axis.start + axis.step * torch.arange(axis.nodes, dtype=torch.float64) for axis in grid.axes]
    nodes = torch.cartesian_prod(*axes)
    columns = torch.randn(grid.nodes, 3, dtype=torch.float64)
    expected = KERNEL(nodes, nodes) @ columns
    torch.testing.assert_close(torch.from_numpy(grid.times_kernel(columns.numpy())), expected)


def test_a_long_axis_is_multiplied_by_fourier_transforms(monkeypatch):
    columns = torch.randn(PoseGrid.of(poses_in_room(30), KERNEL, 1.0).nodes, 3, dtype=torch.float64).numpy()
    dense = PoseGrid.of(poses_in_room(30), KERNEL, 1.0).times_kernel(columns)
    monkeypatch.setattr("sextant.localization.observation._pose_grid.DENSE", 1)
    np.testing.assert_allclose(PoseGrid.of(poses_in_room(30), KERNEL, 1.0).times_kernel(columns), dense, atol=1e-12)


def test_interpolation_is_exact_at_nodes_and_for_quadratics_between_them():
    grid = PoseGrid.of(poses_in_room(30), KERNEL, 0.5)
    axes = [axis.start + axis.step * torch.arange(axis.nodes, dtype=torch.float64) for axis in grid.axes]
    nodes = torch.cartesian_prod(*axes)
    inner = torch.cartesian_prod(axes[0][3:6], axes[1][3:6], axes[2])
    weights, _ = grid.interpolation(inner)
    torch.testing.assert_close(torch.from_numpy(weights @ nodes[:, :2].numpy()), inner[:, :2])
    np.testing.assert_allclose(abs(weights).max(axis=1).toarray(), 1.0)
    poses = poses_in_room(40, seed=2)
    weights, _ = grid.interpolation(poses)
    quadratic = 1 + 2 * nodes[:, 0] - nodes[:, 1] + 0.5 * nodes[:, 0] ** 2 - nodes[:, 0] * nodes[:, 1]
    expected = 1 + 2 * poses[:, 0] - poses[:, 1] + 0.5 * poses[:, 0] ** 2 - poses[:, 0] * poses[:, 1]
    torch.testing.assert_close(torch.from_numpy(weights @ quadratic.numpy()), expected)


def test_the_interpolated_kernel_is_positive_semidefinite():
    grid = PoseGrid.of(poses_in_room(30), KERNEL, 1.0)
    weights = torch.from_numpy(grid.interpolation(poses_in_room(60, seed=3))[0].toarray())
    covariance = torch.from_numpy(grid.times_kernel(torch.eye(grid.nodes, dtype=torch.float64).numpy()))
    assert torch.linalg.eigvalsh(weights @ covariance @ weights.T).min() > -1e-10


@pytest.mark.slow
def test_it_tends_to_the_exact_process_as_the_grid_grows_finer():
    known, poses = smooth_map(), poses_in_room(100, seed=1)
    exact = ExactGP().fit(known, KERNEL).predict(poses)
    errors = []
    for spacing in (1.0, 0.5, 0.25):
        predicted = SKI(spacing=spacing, rank=240).fit(known, KERNEL).predict(poses)
        errors.append(float((predicted.mean - exact.mean).square().mean().sqrt()))
    assert errors[0] > 4 * errors[1] > 16 * errors[2]
    torch.testing.assert_close(predicted.variance, exact.variance, rtol=0.02, atol=1e-3)


def test_a_root_of_low_rank_errs_on_the_side_of_caution():
    known, poses = smooth_map(), poses_in_room(100, seed=1)
    wide, middle, full = (SKI(rank=rank).fit(known, KERNEL).predict(poses).variance for rank in (10, 60, 240))
    assert (wide >= middle - 1e-4).all()
    assert (middle >= full - 1e-4).all()
    assert wide.mean() > 1.5 * full.mean()


def test_dimensions_in_which_the_map_does_not_vary_are_exact():
    known = on_a_street()
    poses = known.poses + torch.tensor([0.05, 0.3, 0.2])
    exact = ExactGP().fit(known, KERNEL).predict(poses)
    model = SKI(spacing=0.25).fit(known, KERNEL)
    assert model.grid_mean.shape[0] < 250  # one axis, not three
    predicted = model.predict(poses)
    torch.testing.assert_close(predicted.mean, exact.mean, rtol=0, atol=0.01)
    torch.testing.assert_close(predicted.variance, exact.variance, rtol=0.02, atol=1e-3)


def test_beyond_the_grid_it_is_the_prior():
    known = smooth_map()
    predicted = SKI().fit(known, KERNEL).predict(torch.tensor([[1e3, 0, 0], [0, -50.0, 1]], dtype=torch.float64))
    torch.testing.assert_close(predicted.mean, known.mean.double().expand(2, -1))
    torch.testing.assert_close(predicted.variance, torch.full((2,), 1.01, dtype=torch.float64))


def test_a_map_of_one_image_is_the_exact_process():
    known = smooth_map(1)
    poses = poses_in_room(10, seed=1)
    exact, predicted = (model.fit(known, KERNEL).predict(poses) for model in (ExactGP(), SKI()))
    torch.testing.assert_close(predicted.mean, exact.mean, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(predicted.variance, exact.variance, rtol=1e-5, atol=1e-5)


def test_it_does_not_depend_on_other_random_numbers():
    known, poses = smooth_map(), poses_in_room(10, seed=1)
    torch.manual_seed(0)
    first = SKI(rank=30).fit(known, KERNEL).predict(poses).variance
    torch.manual_seed(1)
    assert torch.equal(first, SKI(rank=30).fit(known, KERNEL).predict(poses).variance)


def test_a_kernel_that_is_no_product_is_refused():
    kernel = PoseKernel("matern32", (1.5, 1.2), 0.9, signal_variance=1.0, noise_variance=0.01)
    with pytest.raises(UserError, match=r"kernel\.spatial=matern32"):
        SKI().fit(smooth_map(), kernel)


def test_a_kernel_without_noise_is_refused():
    with pytest.raises(UserError, match=r"kernel\.noise_variance=0.0 must be above 0"):
        SKI().fit(smooth_map(), PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.0))


def test_a_grid_over_a_city_is_refused_before_memory_is_taken():
    poses = poses_in_room(50) * torch.tensor([1e6, 1e6, 1.0])
    known = DescriptorMap.of(poses, descriptors_at(poses, 2))
    with pytest.raises(UserError, match=r"spacing=0.5 makes a grid of [\d,]+ poses"):
        SKI().fit(known, KERNEL)
