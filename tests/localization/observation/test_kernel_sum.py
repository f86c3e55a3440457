import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.observation.battery import ObservationModelBattery
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.kernel_sum import KernelSum


class TestKernelSumPassesTheBattery(ObservationModelBattery):
    mean_tolerance, nll_tolerance = 0.5, 1.1  # it knows nothing of the kernel

    def model(self):
        return KernelSum(heading_weight=1.0)


def brute_force(model: KernelSum, poses, query) -> np.ndarray:
    """The formula of the source, image by image."""
    known = model.map
    there, here = known.poses.numpy(), poses.numpy()
    moved = np.linalg.norm(there[None, :, :2] - here[:, None, :2], axis=-1)
    turned = np.abs((there[None, :, 2] - here[:, None, 2] + np.pi) % (2 * np.pi) - np.pi)
    distance = moved + model.heading_weight * turned
    apart = np.linalg.norm(known.descriptors.double().numpy() - query.double().numpy(), axis=1)
    low, high = np.quantile(apart, [0.025, 0.975])
    terms = np.exp(-model.pose_rate * distance) * np.exp(-math.log(model.contrast) / (high - low) * apart)
    nearest = np.argsort(distance, axis=1)[:, : model.neighbours]
    return np.log(np.take_along_axis(terms, nearest, axis=1).sum(1))


@given(st.integers(0, 1000), st.integers(1, 5), st.sampled_from([0.01, 1.0, 15.0, 300.0]))
def test_it_is_the_formula_of_the_source(seed, neighbours, heading_weight):
    model = KernelSum(neighbours=neighbours, heading_weight=heading_weight).fit(smooth_map(), KERNEL)
    poses, query = poses_in_room(30, seed=seed), descriptors_at(poses_in_room(1, seed=seed + 1), 6)
    told = model.observe(query, Likelihood()).log_likelihood(poses[None])[0]
    np.testing.assert_allclose(told, brute_force(model, poses, query[0]), rtol=1e-5)


@given(st.integers(0, 1000), st.integers(1, 8), st.floats(0.01, 100))
def test_neighbours_are_the_nearest_by_its_own_distance(seed, neighbours, heading_weight):
    """Many images at few positions, with headings across the break of the circle."""
    poses = poses_in_room(80, seed=seed)
    poses[:, :2] = poses[:, :2].round()
    poses[::7, 2] = -torch.pi
    model = KernelSum(neighbours=neighbours, heading_weight=heading_weight)
    model.fit(DescriptorMap(poses, torch.randn(80, 2), torch.zeros(2)), KERNEL)
    asked = poses_in_room(20, seed=seed + 1)
    asked[0, 2], asked[1, 2] = -1e-18, torch.pi
    images, distance = model.nearest(asked)
    moved = (asked[:, None, :2] - poses[None, :, :2]).norm(dim=-1)
    turned = torch.acos((asked[:, None, 2] - poses[None, :, 2]).cos().clamp(-1, 1))
    everywhere = moved + heading_weight * turned
    best = everywhere.sort(dim=1).values[:, :neighbours]
    torch.testing.assert_close(distance, best, rtol=1e-6, atol=1e-6 * heading_weight)
    torch.testing.assert_close(everywhere.gather(1, images), best, rtol=1e-6, atol=1e-6 * heading_weight)


def test_95_percent_of_the_map_span_a_factor_of_five():
    known = smooth_map()
    model = KernelSum(neighbours=1).fit(known, KERNEL)
    told = model.observe(descriptors_at(poses_in_room(1, seed=3), 6), Likelihood()).over_map()[0]
    low, high = told.quantile(torch.tensor([0.025, 0.975], dtype=torch.float64))
    assert (high - low).item() == pytest.approx(math.log(5), rel=1e-6)


def test_the_first_query_sets_the_rate_and_later_ones_do_not_change_it():
    model = KernelSum().fit(smooth_map(), KERNEL)
    assert model.state()["appearance_rate"].isnan().all()
    blind = torch.full((1, 6), math.nan)
    assert model.observe(blind, Likelihood()).over_map().isnan().all()
    assert model.state()["appearance_rate"].isnan().all()
    model.observe(descriptors_at(poses_in_room(1, seed=3), 6), Likelihood())
    rate = model.state()["appearance_rate"].item()
    model.observe(descriptors_at(poses_in_room(1, seed=4), 6) * 3, Likelihood())
    assert model.state()["appearance_rate"].item() == rate
    model.fit(smooth_map(), KERNEL)
    assert model.state()["appearance_rate"].isnan().all()


def test_a_rate_that_is_given_is_kept():
    model = KernelSum(appearance_rate=2.5).fit(smooth_map(), KERNEL)
    model.observe(descriptors_at(poses_in_room(1, seed=3), 6), Likelihood())
    assert model.state()["appearance_rate"].item() == 2.5


def test_tempering_multiplies():
    model = KernelSum().fit(smooth_map(), KERNEL)
    query, poses = descriptors_at(poses_in_room(1, seed=3), 6), poses_in_room(5, seed=4)[None]
    full = model.observe(query, Likelihood()).log_likelihood(poses)
    half = model.observe(query, Likelihood(tempering=0.5)).log_likelihood(poses)
    torch.testing.assert_close(half, full / 2)


def test_its_prediction_is_the_neighbours_mean_with_their_variance():
    poses = torch.tensor([[0.0, 0, 0], [1.0, 0, 0], [50.0, 0, 0]], dtype=torch.float64)
    known = DescriptorMap.of(poses, torch.tensor([[0.0, 0.0], [2.0, 4.0], [9.0, 9.0]]))
    predicted = KernelSum(neighbours=2).fit(known, KERNEL).predict(torch.tensor([[0.5, 0, 0]], dtype=torch.float64))
    torch.testing.assert_close(predicted.mean, torch.tensor([[1.0, 2.0]], dtype=torch.float64))
    # squares of 1 and 2, mean over dimensions 2.5, for both neighbours
    assert predicted.variance.item() == pytest.approx(2.5 + KERNEL.noise_variance)


def test_a_map_in_which_all_images_are_as_far_tells_nothing():
    known = DescriptorMap.of(poses_in_room(5), torch.ones(5, 2))
    told = KernelSum(neighbours=1).fit(known, KERNEL).observe(torch.zeros(1, 2), Likelihood()).over_map()
    assert (told == 0).all()


def test_more_neighbours_than_images_are_refused():
    with pytest.raises(UserError, match=r"neighbours=3.*2 images"):
        KernelSum().fit(smooth_map(2), KERNEL)


def test_a_look_at_the_images_tells_more_than_the_poses_alone():
    """On a street driven twice, the sum finds the side that an image was taken on; with all images alike it cannot."""
    poses = torch.zeros(40, 3, dtype=torch.float64)
    poses[:20, 0] = poses[20:, 0] = torch.arange(20.0)
    poses[20:, 1] = 30.0
    descriptors = torch.eye(40)
    model = KernelSum().fit(DescriptorMap.of(poses, descriptors), KERNEL)
    told = model.observe(descriptors[[5, 25]], Likelihood()).log_likelihood(poses[[5, 25]].expand(2, -1, -1))
    assert told[0, 0] > told[0, 1]
    assert told[1, 1] > told[1, 0]
    torch.testing.assert_close(told[0, 0], told[1, 1])
