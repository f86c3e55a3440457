import pytest
import torch
from localization.observation.battery import GaussianBattery
from localization.observation.smooth_map import KERNEL, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.local_gp import LocalGP


class TestLocalGPPassesTheBattery(GaussianBattery):
    mean_tolerance = 0.15
    nll_tolerance = 0.25

    def model(self):
        return LocalGP(neighbours=16)


class TestLocalGPOfTheNearestImagePassesTheBattery(GaussianBattery):
    mean_tolerance = 0.25
    nll_tolerance = 0.35

    def model(self):
        return LocalGP(neighbours=16, neighbourhood="nearest_image")


@pytest.mark.parametrize("neighbourhood", ["own", "nearest_image"])
def test_with_all_images_for_neighbours_it_is_the_exact_process(neighbourhood):
    known, poses = smooth_map(60), poses_in_room(30, seed=1)
    local = LocalGP(60, neighbourhood).fit(known, KERNEL).predict(poses)
    exact = ExactGP().fit(known, KERNEL).predict(poses)
    torch.testing.assert_close(local.mean, exact.mean, rtol=0, atol=1e-6)
    torch.testing.assert_close(local.variance, exact.variance, rtol=0, atol=1e-12)


def test_it_is_the_exact_process_of_a_map_of_the_neighbours():
    known, pose = smooth_map(), poses_in_room(1, seed=2)
    near = (-KERNEL(pose, known.poses)[0]).argsort()[:7]  # by covariance: the order of the features' distances for rbf
    fewer = type(known)(known.poses[near], known.descriptors[near], known.mean)
    ours, theirs = LocalGP(7).fit(known, KERNEL).predict(pose), ExactGP().fit(fewer, KERNEL).predict(pose)
    torch.testing.assert_close(ours.mean, theirs.mean, rtol=0, atol=1e-6)
    torch.testing.assert_close(ours.variance, theirs.variance, rtol=0, atol=1e-12)


def test_more_neighbours_leave_less_variance_and_never_less_than_the_exact_process():
    known, poses = smooth_map(), poses_in_room(50, seed=3)
    few, many = (LocalGP(k).fit(known, KERNEL).predict(poses).variance for k in (4, 32))
    exact = ExactGP().fit(known, KERNEL).predict(poses).variance
    assert (few >= many - 1e-12).all()
    assert (many >= exact - 1e-12).all()


def test_the_error_to_the_exact_process_falls_with_the_neighbours():
    known, poses = smooth_map(), poses_in_room(200, seed=4)
    exact = ExactGP().fit(known, KERNEL).predict(poses).mean
    errors = [
        (LocalGP(k).fit(known, KERNEL).predict(poses).mean - exact).square().mean().sqrt().item()
        for k in (2, 8, 32, 128)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < errors[0] / 10


@pytest.mark.parametrize(("neighbours", "said"), [(0, "at least 1"), (241, r"\[1, 240\]")])
def test_a_number_of_neighbours_that_the_map_has_not_is_refused_with_the_key(neighbours, said):
    with pytest.raises(UserError, match=rf"neighbours={neighbours} must be .*{said}"):
        LocalGP(neighbours).fit(smooth_map(), KERNEL)
