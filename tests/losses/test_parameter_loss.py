"""Losses on the parameters: scales and penalties."""

import math

import pytest
import torch

from sextant.geometry import Parameterization, ParameterSpace
from sextant.losses import ParameterLoss

ONE = torch.ones(1)


def space(name="horizon"):
    low, high = [-0.5, -0.25, 0.5, -1.0], [0.5, 0.25, 1.5, 1.0]
    return ParameterSpace(Parameterization(name), torch.tensor(low), torch.tensor(high))


def one_wrong(loss, number, error):
    truth = torch.tensor([[0.1, 0.1, 1.0, -0.2]])
    said = truth.clone()
    said[0, number] += error
    return loss(said, truth, ONE).item()


def penalties(loss, error=0.01):
    """Root of four times the loss of each number alone, per unit of error: its scale."""
    return [math.sqrt(4 * one_wrong(loss, number, error)) / error for number in range(4)]


def test_range_units_divide_by_the_width_of_the_range():
    assert penalties(ParameterLoss(space(), units="range")) == pytest.approx([1, 2, 1, 0.5], rel=1e-4)


def test_natural_units_take_radians_and_heights():
    assert penalties(ParameterLoss(space("direct"), units="natural")) == pytest.approx([1] * 4, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("direct", [180 / math.pi, 180 / math.pi, 224, 1]),
        ("horizon", [224, 180 / math.pi, 180 / math.pi, 1]),
        ("undistorted_horizon", [224, 180 / math.pi, 180 / math.pi, 1]),
    ],
)
def test_raw_units_are_degrees_and_pixels(name, expected):
    assert penalties(ParameterLoss(space(name), units="raw")) == pytest.approx(expected, rel=1e-4)


def test_in_raw_units_the_distortion_drowns():
    share = torch.tensor(penalties(ParameterLoss(space("direct"), units="raw"))).square()
    assert share[3] / share.sum() < 1e-4


def test_l2_is_the_mean_of_the_squares_of_each_image():
    said, truth = torch.tensor([[1.0, 2.0, 3.0, 4.0], [0.0, 0, 0, 1]]), torch.zeros(2, 4)
    found = ParameterLoss(space(), units="natural")(said, truth, torch.ones(2))
    torch.testing.assert_close(found, torch.tensor([30 / 4, 1 / 4]))


def test_huber_is_l2_near_0_and_linear_far_away_and_smooth_between():
    delta = 0.1
    l2, huber = (ParameterLoss(space(), units="natural", penalty=p, delta=delta) for p in ("l2", "huber"))
    assert one_wrong(huber, 1, 0.05) == pytest.approx(one_wrong(l2, 1, 0.05))
    assert one_wrong(huber, 1, 1.0) == pytest.approx((delta * (2 * 1.0 - delta)) / 4, rel=1e-5)
    errors = torch.tensor([0.5, 0.0999, 0.1001, -2.0], dtype=torch.float64)
    said = torch.zeros(4, 4, dtype=torch.float64)
    said[:, 0] = errors
    said.requires_grad_()
    (slope,) = torch.autograd.grad(huber(said, torch.zeros(4, 4).double(), torch.ones(4)).sum(), said)
    torch.testing.assert_close(slope[:, 0], errors.clamp(-delta, delta) / 2)
    # torch's own is half of it
    own = torch.nn.functional.huber_loss(said, torch.zeros_like(said), delta=delta, reduction="none").mean(-1)
    torch.testing.assert_close(huber(said, torch.zeros_like(said), torch.ones(4)), 2 * own)


@pytest.mark.parametrize("units", ["raw", "range", "natural", "learned"])
@pytest.mark.parametrize("penalty", ["l2", "huber"])
def test_gradients_are_those_of_finite_differences(units, penalty):
    loss = ParameterLoss(space(), units=units, penalty=penalty, delta=0.3)
    generator = torch.Generator().manual_seed(0)
    said = torch.randn(3, 4, generator=generator, dtype=torch.float64).requires_grad_()
    truth = torch.randn(3, 4, generator=generator, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda values: loss(values, truth, torch.ones(3)), [said])


def test_half_precision_is_compared_in_single():
    loss = ParameterLoss(space(), units="raw")
    said = torch.full((1, 4), 0.5).half()
    assert loss(said, torch.zeros(1, 4), ONE).dtype == torch.float32
    assert loss.state_dict() == {}


def test_learned_variances_settle_at_the_mean_squared_errors_and_weigh_each_number_by_them():
    """Numbers whose errors differ by a factor of ten each, the smallest unit first."""
    loss = ParameterLoss(space(), units="learned")
    width, spread = loss.space.high - loss.space.low, torch.tensor([0.003, 0.03, 0.3, 0.03])
    errors = spread * torch.randn(4000, 4, generator=torch.Generator().manual_seed(0))
    errors_of = errors * width
    optimizer = torch.optim.Adam(loss.parameters(), lr=0.01)
    for _ in range(600):
        optimizer.zero_grad()
        loss(errors_of, torch.zeros(4000, 4), torch.ones(4000)).mean().backward()
        optimizer.step()
    torch.testing.assert_close(loss.log_variance.exp(), errors.square().mean(0), rtol=0.05, atol=0)
    said = errors_of.clone().requires_grad_()
    (slope,) = torch.autograd.grad(loss(said, torch.zeros(4000, 4), torch.ones(4000)).sum(), said)
    pull = (slope * width).square().mean(0).sqrt() * errors.square().mean(0).sqrt()
    torch.testing.assert_close(pull, torch.full((4,), 0.5), rtol=0.05, atol=0)  # all four count alike: 2 / 4


def test_learned_variances_start_even_and_are_kept_with_the_loss():
    loss = ParameterLoss(space(), units="learned")
    assert loss.log_variance.exp().tolist() == pytest.approx([1 / 12] * 4)
    assert list(loss.state_dict()) == ["paced"]
    assert ParameterLoss(space(), units="range").log_variance.tolist() == [0.0] * 4
