import math
from dataclasses import replace

import pytest
import torch
from localization.observation.battery import LIKELIHOODS, ObservationModelBattery
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.observation.kernel_mixture import KernelMixture
from sextant.localization.saved_map import load_map, save_map


class TestKernelMixturePassesTheBattery(ObservationModelBattery):
    mean_tolerance = 0.25
    nll_tolerance = 0.35
    map_is_exact = False

    def model(self):
        return KernelMixture(neighbours=16, headings=[1.0, 2.5])  # in this room headings are many


def asked(dimension=12):
    poses = poses_in_room(60, seed=3).view(2, 30, 3)
    return descriptors_at(poses[:, 0], dimension, seed=1), poses


@pytest.mark.parametrize("likelihood", LIKELIHOODS)
def test_the_likelihood_is_the_mean_of_those_under_each_length(likelihood):
    known, (images, poses) = smooth_map(90, dimension=12), asked()
    mixed = KernelMixture(8, headings=[0.5, 1.0, 2.0]).fit(known, KERNEL).observe(images, likelihood)
    alone = [
        CachedLocalGP(8, map_evidence="mean")
        .fit(known, replace(KERNEL, heading_length=c * KERNEL.heading_length))
        .observe(images, likelihood)
        for c in (0.5, 1.0, 2.0)
    ]
    mean = torch.stack([each.log_likelihood(poses) for each in alone]).logsumexp(0) - math.log(3)
    torch.testing.assert_close(mixed.log_likelihood(poses), mean)
    assert mixed.over_map().equal(alone[0].over_map())  # that of the first length
    at_images = mixed.log_likelihood(known.poses.expand(2, -1, -1))
    assert (at_images > mixed.over_map() - math.log(3) - 0.05).all()  # but for rounding


def test_one_length_is_the_local_process():
    known, (images, poses) = smooth_map(90, dimension=12), asked()
    mixed = KernelMixture(8, headings=[1.0]).fit(known, KERNEL)
    plain = CachedLocalGP(8, map_evidence="mean").fit(known, KERNEL)
    told = [model.observe(images, Likelihood()).log_likelihood(poses) for model in (mixed, plain)]
    torch.testing.assert_close(*told)
    assert mixed.predict(poses[0]).variance.equal(plain.predict(poses[0]).variance)


def test_a_view_between_those_of_the_map_is_found_by_the_longer_length():
    """Two images 45 degrees apart, which a length of 11 degrees knows nothing between."""
    poses = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, math.radians(45)]], dtype=torch.float64)
    known, kernel = DescriptorMap.of(poses, torch.eye(2)), replace(KERNEL, heading_length=0.2, noise_variance=0.01)
    between, image = torch.tensor([[[0.0, 0.0, math.radians(22)]]], dtype=torch.float64), torch.tensor([[0.6, 0.4]])
    one, two = (
        KernelMixture(2, headings=headings).fit(known, kernel).observe(image, Likelihood()).log_likelihood(between)
        for headings in ([1.0], [1.0, 4.0])
    )
    assert float(two) > float(one) + 1


def test_where_the_kernels_disagree_the_variance_says_so():
    known, (_, poses) = smooth_map(30, dimension=12), asked()
    far = KernelMixture(8, headings=[0.2, 3.0]).fit(known, KERNEL)
    within = torch.stack([part.predict(poses[0]).variance for part in far.parts]).mean(0)
    assert (far.predict(poses[0]).variance >= within).all()
    assert (far.predict(poses[0]).variance > 1.01 * within).any()


def test_a_saved_one_is_the_same(tmp_path):
    known, (images, poses) = smooth_map(40, dimension=12), asked()
    model = KernelMixture(8, headings=[1.0, 3.0]).fit(known, KERNEL)
    save_map(tmp_path, model, Likelihood(), {})
    again = load_map(tmp_path).model
    assert again.headings == [1.0, 3.0]
    told = [each.observe(images, Likelihood()).log_likelihood(poses) for each in (model, again)]
    assert told[0].equal(told[1])
