import math

import pytest
import torch

from sextant.geometry import CameraParameters, Parameterization, ParameterSpace
from sextant.losses import PoseLensLoss

ANGLES = Parameterization("angles")
SPACE = ParameterSpace(ANGLES, torch.tensor([-1.5, -0.8, 0.2, -0.5]), torch.tensor([1.5, 0.8, 2.0, 0.1]))


def numbers(tilt=0.0, roll=0.0, focal=0.9, k1=-0.1):
    return ANGLES.encode(
        CameraParameters(*(torch.tensor([value], dtype=torch.float64) for value in (tilt, roll, focal, k1)))
    )


def loss(found, true, **weights):
    return float(PoseLensLoss(SPACE, **weights)(found, true, torch.ones(1, dtype=torch.float64)))


def test_the_right_camera_costs_nothing():
    assert loss(numbers(), numbers()) == pytest.approx(0, abs=1e-9)


def test_roll_counts_by_how_far_it_turns_gravity():
    level = loss(numbers(roll=0.3), numbers())
    down = loss(numbers(tilt=-1.4, roll=0.3), numbers(tilt=-1.4))
    assert level == pytest.approx(2 * math.sin(0.15), abs=0.006)
    assert down == pytest.approx(level * math.cos(1.4), abs=0.006)


def test_focal_length_counts_by_its_ratio_and_its_weight():
    for focal in (0.4, 3.0):
        off = loss(numbers(focal=1.1 * focal), numbers(focal=focal), focal_weight=0.5)
        assert off == pytest.approx(0.5 * math.log(1.1), abs=0.003)


def test_distortion_counts_where_it_is_seen():
    wide, long = (loss(numbers(focal=f, k1=-0.3), numbers(focal=f, k1=-0.1)) for f in (0.5, 3.0))
    assert wide > 10 * long > 0


def test_errors_count_by_their_size():
    near, far = (loss(numbers(tilt=t), numbers()) for t in (0.1, 0.2))
    assert far == pytest.approx(2 * near, rel=0.05)


def test_gradients_are_finite_at_the_truth():
    found = numbers().requires_grad_()
    PoseLensLoss(SPACE)(found, numbers(), torch.ones(1)).sum().backward()
    assert found.grad.isfinite().all()
