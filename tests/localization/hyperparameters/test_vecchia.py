import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.observation.smooth_map import KERNEL, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.hyperparameters import (
    Conditioning,
    TrainableKernel,
    joint_log_likelihood,
    preceding_neighbours,
    random_order,
    vecchia_log_likelihood,
)
from sextant.localization.pose_kernel import PoseKernel


def features_of(known):
    return KERNEL.features(known.poses).numpy()


def shuffled(images, seed=0):
    return random_order(images, torch.Generator().manual_seed(seed))


@given(st.integers(1, 150), st.integers(1, 20), st.integers(0, 1000), st.booleans())
def test_neighbours_are_the_nearest_earlier_rows(rows, neighbours, seed, repeated):
    features = np.random.default_rng(seed).normal(size=(rows, 3))
    if repeated:
        features = features.round()
    table = preceding_neighbours(features, neighbours)
    assert table.shape == (rows, neighbours)
    distance = np.linalg.norm(features[:, None] - features, axis=-1)
    for row in range(rows):
        found = table[row][table[row] >= 0]
        assert len(set(found)) == len(found) == min(row, neighbours)
        assert (found < row).all()
        np.testing.assert_allclose(distance[row, found], np.sort(distance[row, :row])[: len(found)])


def test_rows_in_sequence_find_their_neighbours_too():
    """The hard case for a tree of a prefix: along a street every near row of the newer half may be later."""
    features = np.arange(300.0)[::-1, None].copy()
    np.testing.assert_array_equal(preceding_neighbours(features, 2)[2:], np.arange(2, 300)[:, None] - [1, 2])


@pytest.mark.parametrize("order", [np.arange, shuffled])
def test_given_all_earlier_images_it_is_the_joint_likelihood(order):
    known, kernel = smooth_map(60), TrainableKernel(KERNEL)
    conditioning = Conditioning.of(features_of(known), order(60), neighbours=59)
    ours = vecchia_log_likelihood(kernel, known.poses, known.descriptors, known.mean, conditioning)
    joint = joint_log_likelihood(kernel, known.poses, known.descriptors, known.mean)
    assert ours.item() == pytest.approx(joint.item(), rel=1e-9)
    gradients = [
        torch.autograd.grad(value, [p for p in kernel.parameters() if p.requires_grad]) for value in (ours, joint)
    ]
    for of_ours, of_joint in zip(*gradients, strict=True):
        torch.testing.assert_close(of_ours, of_joint, rtol=1e-6, atol=1e-6)


def test_it_approaches_the_joint_likelihood_as_neighbours_are_added():
    known, kernel = smooth_map(), TrainableKernel(KERNEL)
    joint = joint_log_likelihood(kernel, known.poses, known.descriptors, known.mean).item()
    errors = []
    for neighbours in (5, 15, 50):
        conditioning = Conditioning.of(features_of(known), shuffled(240), neighbours)
        ours = vecchia_log_likelihood(kernel, known.poses, known.descriptors, known.mean, conditioning).item()
        errors.append(abs(ours - joint))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.02 * 240 * 6  # in nats a value
    assert errors[-1] < errors[0] / 4


@pytest.mark.slow
def test_expected_on_data_of_the_kernel_it_is_never_above_the_joint_likelihood():
    """Its expectation falls short by the divergence of the densities, and conditioning on more can only help."""
    known, kernel = smooth_map(100), TrainableKernel(KERNEL)
    noisy = KERNEL(known.poses, known.poses) + KERNEL.noise_variance * torch.eye(100, dtype=torch.float64)
    draws = torch.linalg.cholesky(noisy) @ torch.randn(
        100, 4000, generator=torch.Generator().manual_seed(1), dtype=torch.float64
    )
    values = [
        vecchia_log_likelihood(
            kernel,
            known.poses,
            draws,
            torch.zeros(4000),
            Conditioning.of(features_of(known), shuffled(100), neighbours),
        ).item()
        for neighbours in (1, 3, 9, 27, 99)
    ]
    assert values == sorted(values)


def test_minibatches_are_unbiased_in_value_and_gradient():
    """The mean over a partition into equal batches is the value of all rows, exactly."""
    known, kernel = smooth_map(120), TrainableKernel(KERNEL)
    conditioning = Conditioning.of(features_of(known), shuffled(120), neighbours=10)

    def value_and_gradient(rows):
        value = vecchia_log_likelihood(kernel, known.poses, known.descriptors, known.mean, conditioning, rows)
        gradient = torch.autograd.grad(value, kernel.raw_noise)[0]
        return torch.stack([value.detach(), gradient])

    whole = value_and_gradient(None)
    batches = torch.randperm(120, generator=torch.Generator().manual_seed(2)).split(30)
    torch.testing.assert_close(torch.stack([value_and_gradient(rows) for rows in batches]).mean(0), whole)


def test_the_first_image_alone_is_its_prior():
    known, kernel = smooth_map(1), TrainableKernel(KERNEL)
    conditioning = Conditioning.of(features_of(known), np.arange(1), neighbours=5)
    ours = vecchia_log_likelihood(kernel, known.poses, known.descriptors, torch.zeros(6), conditioning)
    prior = torch.distributions.Normal(0.0, (KERNEL.signal_variance + KERNEL.noise_variance) ** 0.5)
    assert ours.item() == pytest.approx(prior.log_prob(known.descriptors).sum().item(), rel=1e-5)


@pytest.mark.slow
def test_a_kernel_trained_with_it_is_near_the_one_trained_with_the_joint_likelihood():
    known = smooth_map(150)
    conditioning = Conditioning.of(features_of(known), shuffled(150), neighbours=20)
    found = []
    for likelihood in (
        lambda kernel: joint_log_likelihood(kernel, known.poses, known.descriptors, known.mean),
        lambda kernel: vecchia_log_likelihood(kernel, known.poses, known.descriptors, known.mean, conditioning),
    ):
        kernel = TrainableKernel.from_map(known.poses, known.descriptors)
        optimizer = torch.optim.Adam(kernel.parameters(), lr=0.1)
        for _ in range(60):
            optimizer.zero_grad()
            (-likelihood(kernel)).backward()
            optimizer.step()
        frozen = kernel.frozen()
        found.append([*frozen.length, frozen.heading_length, frozen.noise_variance])
    assert found[1] == pytest.approx(found[0], rel=0.15)


def test_no_neighbour_is_refused():
    with pytest.raises(UserError, match=r"neighbours=0"):
        Conditioning.of(features_of(smooth_map(5)), np.arange(5), neighbours=0)


def test_an_order_that_is_no_permutation_is_refused():
    with pytest.raises(ValueError, match="each of the 5 images once"):
        Conditioning.of(features_of(smooth_map(5)), np.zeros(5, dtype=np.int64), neighbours=2)


def test_images_at_one_place_without_noise_are_refused_with_an_image():
    kernel = TrainableKernel(PoseKernel("rbf", (1e6, 1e6), 1.0, 1.0, 1e-18))
    poses = poses_in_room(50) * torch.tensor([1, 1, 0])
    conditioning = Conditioning.of(poses.numpy(), np.arange(50), neighbours=20)
    with pytest.raises(UserError, match=r"near image \d+"):
        vecchia_log_likelihood(kernel, poses, torch.randn(50, 2), torch.zeros(2), conditioning)
