import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from localization.observation.smooth_map import descriptors_at, poses_in_room

from sextant.errors import UserError
from sextant.localization.hyperparameters import TrainableKernel, joint_log_likelihood
from sextant.localization.pose_kernel import PoseKernel

SPATIAL = st.sampled_from(["rbf", "matern32", "matern52"])
POSITIVE = st.floats(0.05, 20)


@given(SPATIAL, POSITIVE, POSITIVE, st.floats(0.1, 5), POSITIVE, POSITIVE)
def test_it_is_the_frozen_kernel(spatial, x, y, heading, signal, noise):
    """Two implementations of one formula: GPyTorch's, and the closed one."""
    start = PoseKernel(spatial, (x, y), heading, signal, noise)
    trainable = TrainableKernel(start)
    a, b = poses_in_room(12, seed=1), poses_in_room(9, seed=2)
    torch.testing.assert_close(trainable(a, b).detach(), start(a, b), rtol=1e-9, atol=1e-12 * signal)
    frozen = trainable.frozen()
    assert frozen.spatial == spatial
    values = [*frozen.length, frozen.heading_length, frozen.signal_variance, frozen.noise_variance]
    assert values == pytest.approx([x, y, heading, signal, noise], rel=1e-12)


def test_batches_are_as_one_by_one():
    kernel = TrainableKernel(PoseKernel("matern52", (1.0, 2.0), 0.7, 1.0, 0.1))
    a, b = poses_in_room(20, seed=1).view(4, 5, 3), poses_in_room(12, seed=2).view(4, 3, 3)
    together = kernel(a, b)
    for row in range(4):
        torch.testing.assert_close(together[row], kernel(a[row], b[row]))


def test_without_ard_x_and_y_share_a_length():
    kernel = TrainableKernel(PoseKernel("rbf", (1.0, 4.0), 0.7, 1.0, 0.1), ard=False)
    assert kernel.frozen().length == pytest.approx((2.0, 2.0))
    poses = poses_in_room(30)
    descriptors = descriptors_at(poses, 3)
    optimizer = torch.optim.Adam(kernel.parameters(), lr=0.1)
    for _ in range(5):
        optimizer.zero_grad()
        (-joint_log_likelihood(kernel, poses, descriptors, descriptors.mean(0))).backward()
        optimizer.step()
    x, y = kernel.frozen().length
    assert x == y != pytest.approx(2.0)


def test_training_keeps_the_period_and_all_parameters_positive():
    poses = poses_in_room(40)
    descriptors = descriptors_at(poses, 3)
    kernel = TrainableKernel.from_map(poses, descriptors)
    optimizer = torch.optim.Adam(kernel.parameters(), lr=1.0)  # far too fast on purpose
    for _ in range(20):
        optimizer.zero_grad()
        (-joint_log_likelihood(kernel, poses, descriptors, descriptors.mean(0))).backward()
        optimizer.step()
    frozen = kernel.frozen()
    assert min(*frozen.length, frozen.heading_length, frozen.signal_variance, frozen.noise_variance) > 0
    turned = poses + torch.tensor([0, 0, 2 * math.pi], dtype=torch.float64)
    torch.testing.assert_close(kernel(poses, turned), kernel(poses, poses), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("spatial", ["rbf", "matern32", "matern52"])
def test_training_on_a_railway_leaves_y_and_heading_alone(spatial):
    poses = torch.zeros(60, 3, dtype=torch.float64)
    poses[:, 0] = torch.arange(60)
    descriptors = descriptors_at(poses * 0.2, 4)
    kernel = TrainableKernel.from_map(poses, descriptors, spatial=spatial)
    before = kernel.frozen()
    optimizer = torch.optim.Adam(kernel.parameters(), lr=0.05)
    for _ in range(30):
        optimizer.zero_grad()
        loss = -joint_log_likelihood(kernel, poses, descriptors, descriptors.mean(0))
        loss.backward()
        assert all(p.grad is None or p.grad.isfinite().all() for p in kernel.parameters())
        optimizer.step()
    after = kernel.frozen()
    assert after.length[1] == before.length[1]
    assert after.heading_length == before.heading_length
    assert after.length[0] != before.length[0]


@pytest.mark.slow
def test_it_finds_the_parameters_that_made_the_data():
    truth = PoseKernel("rbf", (1.5, 0.6), 0.9, signal_variance=2.0, noise_variance=0.2)
    poses = poses_in_room(150, seed=3)
    factor = torch.linalg.cholesky(truth(poses, poses) + 0.2 * torch.eye(150, dtype=torch.float64))
    descriptors = factor @ torch.randn(150, 40, generator=torch.Generator().manual_seed(4), dtype=torch.float64)
    kernel = TrainableKernel.from_map(poses, descriptors)
    optimizer = torch.optim.Adam(kernel.parameters(), lr=0.1)
    for _ in range(150):
        optimizer.zero_grad()
        (-joint_log_likelihood(kernel, poses, descriptors, torch.zeros(40))).backward()
        optimizer.step()
    found = kernel.frozen()
    values = [*found.length, found.heading_length, found.signal_variance, found.noise_variance]
    assert values == pytest.approx([1.5, 0.6, 0.9, 2.0, 0.2], rel=0.1)


def test_the_start_is_read_off_the_map():
    x, y, heading = (torch.arange(5.0, dtype=torch.float64) for _ in range(3))
    poses = torch.cartesian_prod(0.5 * x, 0.5 * y, heading)  # five views at every place
    descriptors = torch.randn(125, 8, generator=torch.Generator().manual_seed(0))
    start = TrainableKernel.from_map(poses + 1e5, descriptors).frozen()
    assert start.length == pytest.approx((2.0, 2.0), rel=1e-4)
    variance = descriptors.var(dim=0, correction=0).mean().item()
    assert start.signal_variance + start.noise_variance == pytest.approx(variance, rel=1e-5)


def test_the_start_of_one_place_is_finite():
    start = TrainableKernel.from_map(torch.zeros(3, 3, dtype=torch.float64), torch.eye(3)).frozen()
    assert start.length == pytest.approx((4.0, 4.0))


def test_descriptors_that_are_all_alike_are_refused():
    with pytest.raises(UserError, match="5 descriptors are all equal"):
        TrainableKernel.from_map(poses_in_room(5), torch.ones(5, 3))


def test_a_pose_without_descriptor_is_refused():
    with pytest.raises(ValueError, match="need a descriptor for each pose"):
        TrainableKernel.from_map(poses_in_room(5), torch.randn(4, 3))
    with pytest.raises((UserError, TypeCheckError), match=r"must have \(n, 3\)|Type-check error"):
        TrainableKernel.from_map(poses_in_room(5)[:, :2], torch.randn(5, 3))


def test_its_state_is_all_there_is_of_it():
    """A kernel made with other numbers becomes the same by its state: a checkpoint needs no more."""
    poses = poses_in_room(30)
    trained = TrainableKernel.from_map(poses, 100 * descriptors_at(poses, 3))
    again = TrainableKernel(PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 1.0))
    again.load_state_dict(trained.state_dict())
    assert again.frozen() == trained.frozen()
    with torch.no_grad():
        trained.raw_noise -= 50
        again.raw_noise -= 50
    assert again.frozen() == trained.frozen()  # both at the least noise


@pytest.mark.parametrize("unit", [0.01, 1000.0])
def test_training_does_not_depend_on_the_units(unit):
    poses = poses_in_room(60)
    descriptors = descriptors_at(poses, 3)
    scale = torch.tensor([unit, unit, 1])
    found = []
    for some, images in ((poses, descriptors), (poses * scale, unit * descriptors)):
        kernel = TrainableKernel.from_map(some, images)
        optimizer = torch.optim.Adam(kernel.parameters(), lr=0.1)
        for _ in range(20):
            optimizer.zero_grad()
            (-joint_log_likelihood(kernel, some, images, images.mean(0))).backward()
            optimizer.step()
        found.append(kernel.frozen())
    assert found[1].length == pytest.approx([unit * length for length in found[0].length], rel=1e-3)
    assert found[1].noise_variance == pytest.approx(unit**2 * found[0].noise_variance, rel=1e-3)
