"""Motions of the plane against 3 x 3 matrices and their expm and logm."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, logm

from sextant.geometry import se2_between, se2_compose, se2_exp, se2_inverse, se2_log, wrap_angle

small = st.floats(-12, 0).map(lambda e: 10**e)
poses = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1) | small).map(
    lambda values: torch.tensor(values, dtype=torch.float64)
)


def matrix_of(pose):
    x, y, theta = pose.tolist()
    return np.array([[math.cos(theta), -math.sin(theta), x], [math.sin(theta), math.cos(theta), y], [0, 0, 1]])


def generator_of(twist):
    vx, vy, omega = twist.tolist()
    return np.array([[0, -omega, vx], [omega, 0, vy], [0, 0, 0]])


def assert_same(pose, matrix):
    np.testing.assert_allclose(matrix_of(pose), matrix, rtol=0, atol=1e-12)
    assert abs(pose[2]) <= math.pi


@given(st.floats(-100, 100))
def test_a_wrapped_angle_is_the_same_angle(angle):
    wrapped = wrap_angle(torch.tensor(angle, dtype=torch.float64)).item()
    assert -math.pi - 1e-15 <= wrapped < math.pi
    assert (wrapped - angle) / (2 * math.pi) == pytest.approx(round((wrapped - angle) / (2 * math.pi)), abs=1e-12)
    if abs(angle) < 3.14159:
        assert wrapped == angle


def test_half_turns_wrap_to_minus_pi_with_gradient_1():
    angles = torch.tensor([math.pi, -math.pi, 0.0, 1e-300, 7.0], dtype=torch.float64, requires_grad=True)
    wrapped = wrap_angle(angles)
    assert wrapped[:4].tolist() == [-math.pi, -math.pi, 0.0, 1e-300]
    assert torch.autograd.grad(wrapped.sum(), angles)[0].tolist() == [1] * 5


@given(poses, poses)
def test_the_group_is_that_of_the_matrices(first, second):
    assert_same(se2_compose(first, second), matrix_of(first) @ matrix_of(second))
    assert_same(se2_inverse(first), np.linalg.inv(matrix_of(first)))
    assert_same(se2_between(first, second), np.linalg.inv(matrix_of(first)) @ matrix_of(second))
    assert_same(se2_compose(first, se2_between(first, second)), matrix_of(second))


@given(poses)
def test_exponential_and_logarithm_are_those_of_the_matrix(twist):
    pose = se2_exp(twist)
    assert_same(pose, expm(generator_of(twist)))
    torch.testing.assert_close(se2_log(pose), twist, rtol=0, atol=1e-12)
    np.testing.assert_allclose(generator_of(se2_log(pose)), logm(matrix_of(pose)).real, atol=1e-6)


def test_a_quarter_circle_by_hand():
    quarter = torch.tensor([math.pi / 2, 0.0, math.pi / 2], dtype=torch.float64)  # radius 1
    torch.testing.assert_close(se2_exp(quarter), torch.tensor([1.0, 1.0, math.pi / 2], dtype=torch.float64))
    ahead = torch.tensor([2.0, 0.0, 0.0], dtype=torch.float64)
    left = torch.tensor([1.0, 1.0, math.pi / 2], dtype=torch.float64)
    torch.testing.assert_close(se2_compose(left, ahead), torch.tensor([1.0, 3.0, math.pi / 2], dtype=torch.float64))


def test_batches_broadcast():
    particles, motion = torch.zeros(4, 5, 3), torch.tensor([1.0, 0.0, 0.1])
    assert se2_compose(particles, motion).shape == (4, 5, 3)
    assert se2_between(particles[:, :1], particles[0]).shape == (4, 5, 3)
    assert se2_exp(motion).dtype == torch.float32


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-3, 1.0, 2.0, -3.1])
def test_gradients_are_those_of_finite_differences(angle):
    twist = torch.tensor([1.0, -0.5, angle], dtype=torch.float64, requires_grad=True)
    other = torch.tensor([0.3, 2.0, 0.4], dtype=torch.float64, requires_grad=True)
    for function in (se2_exp, se2_log, se2_inverse):
        assert torch.autograd.gradcheck(function, [twist])
        assert torch.autograd.gradgradcheck(function, [twist])
    for function in (se2_compose, se2_between):
        assert torch.autograd.gradcheck(function, [twist, other])
