"""A kernel for telling places apart."""

import pytest
import torch

from benchmarks.place_kernel import IMAGES, discriminative_kernel, log_place_probability, squared_errors
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.pose_kernel import PoseKernel

KERNEL = PoseKernel("rbf", (1.5, 1.5), 1.0, 1.0, 0.2)


@pytest.fixture
def images():
    draws = torch.Generator().manual_seed(0)
    return torch.rand(15, 3, generator=draws).double() * 5, torch.randn(15, 4, generator=draws).double()


def line(count, spacing, overlap=1):
    """Images that share parts with as many of the next."""
    shown = torch.randn(count + overlap, 16, generator=torch.Generator().manual_seed(0))
    poses = torch.zeros(count, 3, dtype=torch.float64)
    poses[:, 0] = spacing * torch.arange(count)
    return DescriptorMap.of(poses, sum(shown[k : k + count] for k in range(overlap + 1)))


def test_predictions_are_those_of_the_other_images(images):
    poses, residuals = images
    found = squared_errors(KERNEL, poses, residuals)
    for left_out in range(len(poses)):
        others = [row for row in range(len(poses)) if row != left_out]
        covariance = KERNEL(poses[others], poses[others]) + 0.2 * torch.eye(len(others))
        predicted = KERNEL(poses, poses[others]) @ torch.linalg.solve(covariance, residuals[others])
        assert torch.allclose(found[left_out], (residuals[left_out] - predicted).square().sum(1))


def test_images_at_one_pose_show_one_place(images):
    poses, residuals = images
    twice = torch.cat([poses, poses]), torch.cat([residuals, residuals + 0.01])
    assert log_place_probability(PoseKernel("rbf", (1.5, 1.5), 1.0, 1.0, 1e-3), *twice) > -0.01


def test_it_does_not_depend_on_the_unit_of_descriptors(images):
    poses, residuals = images
    larger = PoseKernel("rbf", (1.5, 1.5), 1.0, 49.0, 49 * 0.2)
    assert log_place_probability(KERNEL, poses, residuals) == pytest.approx(
        log_place_probability(larger, poses, 7 * residuals)
    )


def test_lengths_follow_the_spacing_and_keep_their_ratio():
    likeliest = PoseKernel("rbf", (8.0, 16.0), 0.7, 1.0, 0.5)
    one, scaled = (discriminative_kernel(likeliest, line(60, spacing)) for spacing in (1.0, 3.0))
    assert scaled.length[0] == pytest.approx(3 * one.length[0])
    assert 0.4 < one.length[0] < 1.2  # longer ones smooth away what tells images apart
    assert one.length[1] == pytest.approx(2 * one.length[0])
    assert (one.heading_length, one.signal_variance, one.noise_variance) == (0.7, 1.0, 1e-3)


def test_a_large_map_is_not_thinned():
    small, large = (discriminative_kernel(KERNEL, line(count, 1.0, 3)) for count in (IMAGES // 2, 3 * IMAGES))
    assert large.length == pytest.approx(small.length, rel=0.2)


def test_a_map_of_two_images_keeps_its_kernel():
    assert discriminative_kernel(KERNEL, line(2, 1.0)) == KERNEL
