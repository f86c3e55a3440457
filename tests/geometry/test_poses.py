"""Poses against products, inverses, expm and logm of matrices; the level camera against values by hand."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, logm

from sextant.geometry import (
    level_camera_pose,
    se3_compose,
    se3_exp,
    se3_from_rotation_translation,
    se3_inverse,
    se3_log,
    so3_hat,
    transform_points,
    up_in_camera,
)

seeds = st.integers(0, 9999)


def twists(seed, *shape, angle=None):
    """Twists with rotations of less than half a turn."""
    values = np.random.default_rng(seed).normal(size=(*shape, 6))
    length = np.linalg.norm(values[..., 3:], axis=-1, keepdims=True)
    values[..., 3:] *= (np.minimum(length, 3) if angle is None else angle) / length
    return torch.from_numpy(values)


def matrix_of(twist):
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = so3_hat(twist[3:])
    matrix[:3, 3] = twist[:3]
    return matrix


@given(seeds, st.none() | st.sampled_from([0.0, 1e-12, 1e-8, 1e-4, 0.1, 0.999, 1.001, 3.1]))
def test_exponential_and_logarithm_are_those_of_the_matrix(seed, angle):
    twist = twists(seed, angle=angle)
    pose = se3_exp(twist)
    np.testing.assert_allclose(pose, expm(matrix_of(twist)), atol=1e-13)
    torch.testing.assert_close(se3_log(pose), twist, rtol=0, atol=1e-12)
    np.testing.assert_allclose(matrix_of(se3_log(pose)), logm(pose.numpy()).real, atol=1e-6)
    assert torch.equal(se3_log(pose[:3]), se3_log(pose))


@given(seeds, st.booleans(), st.booleans())
def test_composition_and_inverse_are_those_of_matrices(seed, short_first, short_second):
    first, second = se3_exp(twists(seed, 2, 5))
    expected = first @ second
    first = first[..., :3, :] if short_first else first
    second = second[..., :3, :] if short_second else second
    torch.testing.assert_close(se3_compose(first, second), expected)
    torch.testing.assert_close(
        se3_inverse(first) @ se3_exp(twists(seed, 2, 5))[0], torch.eye(4).expand(5, 4, 4).double()
    )


@given(seeds)
def test_points_go_through_a_composition_one_step_after_the_other(seed):
    a_from_b, b_from_c = se3_exp(twists(seed, 2, 3))
    points = torch.from_numpy(np.random.default_rng(seed).normal(size=(7, 3)))
    at_once = transform_points(se3_compose(a_from_b, b_from_c), points)
    torch.testing.assert_close(at_once, transform_points(a_from_b, transform_points(b_from_c, points)))
    torch.testing.assert_close(
        at_once[1, 4], (a_from_b[1] @ b_from_c[1] @ torch.cat([points[4], points.new_ones(1)]))[:3]
    )
    assert at_once.shape == (3, 7, 3)


def test_rotation_and_translation_broadcast():
    pose = se3_from_rotation_translation(torch.eye(3), torch.arange(6.0).view(2, 3))
    assert pose.shape == (2, 4, 4)
    assert pose[1].tolist() == [[1, 0, 0, 3], [0, 1, 0, 4], [0, 0, 1, 5], [0, 0, 0, 1]]


R2 = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("heading", "tilt", "roll", "right", "down", "forward"),
    [
        (0, 0, 0, (0, -1, 0), (0, 0, -1), (1, 0, 0)),
        (90, 0, 0, (1, 0, 0), (0, 0, -1), (0, 1, 0)),
        (180, 0, 0, (0, 1, 0), (0, 0, -1), (-1, 0, 0)),
        (45, 0, 0, (R2, -R2, 0), (0, 0, -1), (R2, R2, 0)),
        (0, 45, 0, (0, -1, 0), (R2, 0, -R2), (R2, 0, R2)),  # looks up
        (90, -90, 0, (1, 0, 0), (0, -1, 0), (0, 0, -1)),  # looks down, its lower side to the back
        (0, 0, 90, (0, 0, -1), (0, 1, 0), (1, 0, 0)),  # its right side down
    ],
)
def test_the_level_camera_by_hand(heading, tilt, roll, right, down, forward):
    pose = level_camera_pose(
        1.0, 2.0, 3.0, *(torch.tensor(math.radians(a), dtype=torch.float64) for a in (heading, tilt, roll))
    )
    expected = np.eye(4)
    expected[:3] = np.array([right, down, forward, (1, 2, 3)]).T
    np.testing.assert_allclose(pose, expected, atol=1e-15)


@given(st.floats(-7, 7), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_up_in_the_world_is_up_in_the_camera(heading, tilt, roll):
    angles = [torch.tensor(value, dtype=torch.float64) for value in (heading, tilt, roll)]
    rotation = level_camera_pose(0.0, 0.0, 0.0, *angles)[:3, :3]
    torch.testing.assert_close(rotation @ up_in_camera(*angles[1:]), rotation.new_tensor([0, 0, 1]), rtol=0, atol=1e-14)
    assert torch.linalg.det(rotation).item() == pytest.approx(1)


def test_level_cameras_broadcast_and_numbers_take_the_type_of_tensors():
    pose = level_camera_pose(torch.zeros(5, dtype=torch.float64), 0.0, 1.6, torch.zeros(2, 1, dtype=torch.float64))
    assert pose.shape == (2, 5, 4, 4)
    assert pose.dtype == torch.float64
    assert level_camera_pose(0.0, 0.0, 0.0, 0.0).dtype == torch.float32


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.5, 1.0, 2.9])
def test_gradients_are_those_of_finite_differences(angle):
    twist = twists(3, 2, angle=angle).requires_grad_()
    assert torch.autograd.gradcheck(se3_exp, [twist])
    assert torch.autograd.gradgradcheck(se3_exp, [twist])
    assert torch.autograd.gradcheck(lambda t: se3_log(se3_exp(t)), [twist])
    numbers = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (1.0, 2.0, 3.0, angle, 0.1, -0.2)]
    assert torch.autograd.gradcheck(level_camera_pose, numbers)
