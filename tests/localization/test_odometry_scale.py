import math

import pytest
import torch

from sextant.geometry.planar import se2_compose
from sextant.localization.constants import FURTHER
from sextant.localization.odometry_scale import OdometryScale


def pose(*values):
    return torch.tensor([values], dtype=torch.float64)


def driven(true_scale, step, steps, noise=0.0, spacing=1.0):
    """Estimates that are the truth, with noise, of a robot that turns as it drives; odometry is without its scale."""
    draws = torch.Generator().manual_seed(0)
    scale, at = OdometryScale.none(1), pose(3.0, -2.0, 2.5)
    shown = at
    for _ in range(steps):
        told = scale.applied(pose(step, 0.1 * step, 0.05))
        at = se2_compose(at, pose(true_scale * step, true_scale * 0.1 * step, 0.05))
        before = shown
        shown = at + noise * torch.randn(1, 3, generator=draws, dtype=torch.float64) * pose(1, 1, 0.01)
        scale = scale.updated(told, before, shown, spacing)
    return scale.factor.item()


def scaled(factor):
    return OdometryScale(torch.tensor([factor], dtype=torch.float64))


@pytest.mark.parametrize("true_scale", [0.5, 0.9, 1.0, 1.1, 1.8])
def test_it_finds_the_scale(true_scale):
    assert driven(true_scale, 1.0, 400) == pytest.approx(true_scale, rel=0.01)


def test_noise_of_estimates_hardly_moves_it():
    assert driven(1.2, 1.0, 400, noise=0.3) == pytest.approx(1.2, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("step", "steps"), [(0.1, 4000), (5.0, 100)])
def test_it_does_so_however_long_the_steps_are(step, steps):
    assert driven(1.2, step, steps) == pytest.approx(1.2, rel=0.02)


def test_in_as_many_metres_it_learns_as_much_from_many_frames_as_from_few():
    assert driven(1.3, 0.1, 100) == pytest.approx(driven(1.3, 1.0, 10), rel=0.01)


@pytest.mark.parametrize(
    ("moved", "after"),
    [
        ((0.0, 0.0, 0.3), (0.4, 0.0, 0.3)),
        ((1.0, 0.0, 0.0), (9.0, 0.0, 0.0)),
        ((math.nan, math.nan, math.nan), (1.0, 0.0, 0.0)),
    ],
    ids=["standing", "another place", "no odometry"],
)
def test_it_learns_nothing_where_there_is_nothing_to_learn(moved, after):
    assert scaled(1.5).updated(pose(*moved), pose(0.0, 0.0, 0.0), pose(*after), 1.0).factor == 1.5


def test_it_stays_within_bounds():
    low, high = scaled(1.0), scaled(1.0)
    for _ in range(500):
        low = low.updated(pose(1, 0, 0), pose(0, 0, 0), pose(-0.5, 0, 0), 1.0)
        high = high.updated(pose(1, 0, 0), pose(0, 0, 0), pose(2.5, 0, 0), 1.0)
    assert (low.factor.item(), high.factor.item()) == (1 / FURTHER, FURTHER)


def test_turns_are_left_as_they_are():
    assert scaled(2.0).applied(pose(1, -1, 0.5)).tolist() == [[2.0, -2.0, 0.5]]
