"""Rotations against scipy's, at angles from 0 to pi; tilt, roll and the up vector against each other."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sextant.geometry import (
    rotation_from_tilt_roll,
    so3_exp,
    so3_hat,
    so3_log,
    tilt_roll_from_up,
    up_in_camera,
)

tilts, rolls = st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)
# angles over all scales, those next to 0 and pi among them
angles = st.one_of(
    st.floats(0, math.pi), st.floats(-12, 0).map(lambda e: 10**e), st.floats(-12, -1).map(lambda e: math.pi - 10**e)
)
axes = st.integers(0, 999).map(lambda seed: np.random.default_rng(seed).normal(size=3)) | st.sampled_from(
    [np.eye(3)[0], -np.eye(3)[1], np.eye(3)[2], np.array([1.0, 1.0, 0.0])]
)


def f64(*values):
    return [torch.as_tensor(value, dtype=torch.float64) for value in values]


@given(tilts, rolls)
def test_tilt_and_roll_are_turns_about_x_after_z(tilt, roll):
    expected = Rotation.from_rotvec([tilt, 0, 0]) * Rotation.from_rotvec([0, 0, roll])
    np.testing.assert_allclose(rotation_from_tilt_roll(*f64(tilt, roll)), expected.as_matrix(), atol=1e-15)


@given(tilts, rolls)
def test_up_is_what_gravity_opposes_and_gives_tilt_and_roll_again(tilt, roll):
    tilt, roll = f64(tilt, roll)
    up = up_in_camera(tilt, roll)
    torch.testing.assert_close(rotation_from_tilt_roll(tilt, roll) @ up, f64([0, -1, 0])[0], rtol=0, atol=1e-15)
    torch.testing.assert_close(torch.stack(tilt_roll_from_up(3 * up)), torch.stack([tilt, roll]), rtol=0, atol=1e-14)


def test_signs():
    forward, right = f64([0, 0, 1], [1, 0, 0])
    assert (rotation_from_tilt_roll(*f64(0.3, 0.0)) @ forward)[1] < 0  # looks up, against y
    assert (rotation_from_tilt_roll(*f64(0.0, 0.3)) @ right)[1] > 0  # the right side goes down


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_vertical_camera_has_no_roll_and_finite_gradients(sign):
    up = torch.tensor([0.0, 0.0, sign], dtype=torch.float64, requires_grad=True)
    tilt, roll = tilt_roll_from_up(up)
    assert roll == 0
    assert tilt.item() == pytest.approx(sign * math.pi / 2)
    assert torch.autograd.grad(tilt + roll, up)[0].isfinite().all()


@given(axes, angles)
def test_the_exponential_is_that_of_the_matrix(axis, angle):
    vector = axis / np.linalg.norm(axis) * angle
    rotation = so3_exp(torch.from_numpy(vector))
    np.testing.assert_allclose(rotation, expm(so3_hat(torch.from_numpy(vector)).numpy()), atol=1e-14)
    np.testing.assert_allclose(rotation @ rotation.mT, np.eye(3), atol=2e-15)


@given(axes, angles)
def test_the_logarithm_inverts_it_at_all_scales(axis, angle):
    vector = torch.from_numpy(axis / np.linalg.norm(axis) * angle)
    found = so3_log(so3_exp(vector))
    if angle > 3:  # at pi the vector and its opposite are the same rotation
        np.testing.assert_allclose(so3_exp(found), so3_exp(vector), atol=1e-14)
        assert found.norm() <= math.pi + 1e-12
    if angle < math.pi - 1e-9:
        np.testing.assert_allclose(found, vector, rtol=0, atol=4e-15 + 1e-15 * angle)


@given(axes, st.floats(0.01, 20.0))
def test_the_logarithm_is_the_shortest_vector(axis, angle):
    rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle)
    expected = rotation.as_rotvec()
    if np.linalg.norm(expected) < math.pi - 1e-6:
        np.testing.assert_allclose(so3_log(torch.from_numpy(rotation.as_matrix())), expected, atol=1e-13)


def test_half_turns_have_a_logarithm():
    for axis in (*np.eye(3), np.array([0.6, 0.0, -0.8])):
        half_turn = torch.from_numpy(2 * np.outer(axis, axis) - np.eye(3))
        vector = so3_log(half_turn)
        assert vector.norm().item() == pytest.approx(math.pi)
        np.testing.assert_allclose(so3_exp(vector), half_turn, atol=1e-15)


def test_hat_is_the_cross_product():
    a, b = f64([1.0, -2.0, 3.0], [0.5, 4.0, -1.0])
    torch.testing.assert_close(so3_hat(a) @ b, torch.linalg.cross(a, b))


@pytest.mark.parametrize("scale", [0.0, 1e-9, 1e-3, 0.02, 0.99, 1.0, 3.0, 3.14159])
def test_gradients_are_those_of_finite_differences_from_0_to_pi(scale):
    direction = f64([0.48, -0.6, 0.64])[0]
    vector = (scale * direction).requires_grad_()
    assert torch.autograd.gradcheck(so3_exp, [vector])
    assert torch.autograd.gradgradcheck(so3_exp, [vector])
    if scale < 3.1:
        assert torch.autograd.gradcheck(lambda v: so3_log(so3_exp(v)), [vector])
    # on the manifold, the logarithm's derivative is the inverse of the exponential's
    jacobian = torch.autograd.functional.jacobian(lambda v: so3_log(so3_exp(v)), vector.detach())
    torch.testing.assert_close(jacobian, torch.eye(3, dtype=torch.float64), rtol=0, atol=1e-7)


def test_batches_broadcast_and_float32_stays():
    assert rotation_from_tilt_roll(torch.zeros(4, 1), torch.zeros(3)).shape == (4, 3, 3, 3)
    vectors = torch.randn(5, 2, 3, generator=torch.Generator().manual_seed(0))
    rotations = so3_exp(vectors)
    assert rotations.dtype == torch.float32
    torch.testing.assert_close(rotations[3, 1], so3_exp(vectors[3, 1]))
    torch.testing.assert_close(so3_log(rotations), vectors, rtol=0, atol=2e-6)
    gradient = torch.autograd.functional.jacobian(up_in_camera, (torch.tensor(0.2), torch.tensor(0.1)))
    assert [part.shape for part in gradient] == [(3,), (3,)]
