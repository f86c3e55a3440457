import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.observation.battery import GaussianBattery, elbo, log_density
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.sgpr import SGPR
from sextant.localization.pose_kernel import PoseKernel


class TestSGPRPassesTheBattery(GaussianBattery):
    mean_tolerance, nll_tolerance = 0.08, 0.06

    def model(self):
        return SGPR(inducing=160)


@pytest.mark.parametrize("placement", ["kmeans", "every"])
def test_with_as_many_inducing_poses_as_images_it_is_the_exact_process(placement):
    known, poses = smooth_map(), poses_in_room(100, seed=1)
    exact = ExactGP().fit(known, KERNEL)
    model = SGPR(inducing=len(known), placement=placement).fit(known, KERNEL)
    torch.testing.assert_close(model.predict(poses).mean, exact.predict(poses).mean, rtol=0, atol=1e-6)
    torch.testing.assert_close(model.predict(poses).variance, exact.predict(poses).variance, rtol=1e-6, atol=0)
    assert elbo(model) == pytest.approx(log_density(known, KERNEL), abs=1e-3)


@given(st.integers(1, 60), st.sampled_from(["rbf", "matern32", "matern52"]), st.floats(0.3, 3), st.floats(0.01, 1))
def test_the_bound_is_below_the_log_marginal_likelihood(inducing, spatial, length, noise):
    kernel = PoseKernel(spatial, (length, length), 0.9, signal_variance=1.0, noise_variance=noise)
    known = smooth_map(60)
    exact = log_density(known, kernel)
    assert elbo(SGPR(inducing=inducing).fit(known, kernel)) <= exact + 1e-6 * abs(exact)


def test_the_bound_rises_as_inducing_poses_are_added():
    known = smooth_map()
    shuffled = torch.randperm(240, generator=torch.Generator().manual_seed(2))
    # a nested family: the map is ordered so that every second, fourth, ... image of it is in the larger sets too
    bounds = []
    for inducing in (15, 30, 60, 120, 240):
        known = DescriptorMap(known.poses[shuffled], known.descriptors[shuffled], known.mean)
        shuffled = torch.arange(240)
        bounds.append(elbo(SGPR(inducing=inducing, placement="every").fit(known, KERNEL)))
    assert bounds == sorted(bounds)


def test_the_bound_is_that_of_titsias_written_out_with_dense_matrices():
    known = smooth_map(50)
    model = SGPR(inducing=20).fit(known, KERNEL)
    across = KERNEL(known.poses, model.inducing_poses)
    low_rank = across @ torch.linalg.solve(KERNEL(model.inducing_poses, model.inducing_poses), across.T)
    noisy = low_rank + KERNEL.noise_variance * torch.eye(50, dtype=torch.float64)
    density = torch.distributions.MultivariateNormal(torch.zeros(50, dtype=torch.float64), noisy)
    centred = (known.descriptors - known.mean).double()
    expected = sum(density.log_prob(column) for column in centred.T)
    expected -= 6 / (2 * KERNEL.noise_variance) * (50 * KERNEL.signal_variance - low_rank.trace())
    assert elbo(model) == pytest.approx(float(expected), rel=1e-8)


def test_a_map_that_passes_by_in_blocks_gives_the_same(monkeypatch):
    known, poses = smooth_map(), poses_in_room(20, seed=1)
    whole = SGPR(inducing=30).fit(known, KERNEL)
    monkeypatch.setattr("sextant.localization.observation._feature_regression.ENTRIES", 30 * 7)
    blocks = SGPR(inducing=30).fit(known, KERNEL)
    assert elbo(blocks) == pytest.approx(elbo(whole), rel=1e-9)
    torch.testing.assert_close(blocks.predict(poses).mean, whole.predict(poses).mean)


def test_far_from_the_map_it_is_the_prior():
    predicted = SGPR(inducing=30).fit(smooth_map(), KERNEL).predict(torch.full((1, 3), 1e3, dtype=torch.float64))
    assert predicted.variance.item() == pytest.approx(KERNEL.signal_variance + KERNEL.noise_variance)


def test_a_map_of_one_street_in_which_two_dimensions_do_not_vary():
    poses = torch.zeros(200, 3, dtype=torch.float64)
    poses[:, 0] = torch.arange(200) * 0.2
    known = DescriptorMap.of(poses, descriptors_at(poses, 6))
    exact = ExactGP().fit(known, KERNEL).predict(poses)
    predicted = SGPR(inducing=60).fit(known, KERNEL).predict(poses)
    torch.testing.assert_close(predicted.mean, exact.mean, rtol=0, atol=1e-3)


def test_inducing_poses_do_not_depend_on_other_random_numbers():
    known = smooth_map()
    torch.manual_seed(0)
    first = SGPR(inducing=20, seed=3).fit(known, KERNEL).inducing_poses
    torch.manual_seed(1)
    assert torch.equal(first, SGPR(inducing=20, seed=3).fit(known, KERNEL).inducing_poses)
    assert not torch.equal(first, SGPR(inducing=20, seed=4).fit(known, KERNEL).inducing_poses)


def test_inducing_poses_stay_at_the_maps_headings_across_the_break_of_the_circle():
    """A mean of 179 and -179 degrees is 180 degrees, not 0."""
    poses = poses_in_room(100, seed=5)
    poses[:, 2] = torch.pi + 0.1 * torch.rand(100, dtype=torch.float64) - 0.05
    known = DescriptorMap.of(poses, descriptors_at(poses, 6))
    headings = SGPR(inducing=8).fit(known, KERNEL).inducing_poses[:, 2]
    assert (torch.cos(headings - torch.pi) > 0.99).all()


def test_more_inducing_poses_than_images_are_refused():
    with pytest.raises(UserError, match=r"inducing=241.*240 images"):
        SGPR(inducing=241).fit(smooth_map(), KERNEL)


def test_a_kernel_without_noise_is_refused():
    kernel = PoseKernel("rbf", (1.0, 1.0), 1.0, signal_variance=1.0, noise_variance=0.0)
    with pytest.raises(UserError, match=r"kernel\.noise_variance=0.0 must be above 0 for SGPR"):
        SGPR(inducing=5).fit(smooth_map(), kernel)


def test_the_state_of_another_size_is_refused():
    known = smooth_map()
    state = SGPR(inducing=5).fit(known, KERNEL).state()
    with pytest.raises(ValueError, match="inducing_poses"):
        SGPR(inducing=6).load_state(known, KERNEL, state)


def test_a_state_that_has_the_bound_too_as_those_of_earlier_versions_is_opened():
    known, poses = smooth_map(), poses_in_room(5, seed=1)
    model = SGPR(inducing=5).fit(known, KERNEL)
    former = model.state() | {"elbo": torch.zeros(1, dtype=torch.float64)}
    again = SGPR(inducing=5).load_state(known, KERNEL, former)
    assert torch.equal(again.predict(poses).mean, model.predict(poses).mean)
