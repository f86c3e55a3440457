"""The bearing loss: closed forms, what disentangling does, and the harmonic weights."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from sextant.errors import ArgumentError
from sextant.geometry import CameraParameters, Parameterization, ParameterSpace, PerspectiveCamera, vfov_from_focal
from sextant.losses import BearingLoss, ParameterLoss, PoseLensLoss
from sextant.losses.camera_losses import (
    bearing_difference,
    bearing_grid,
    harmonic_weights,
    one_at_a_time,
    world_bearings,
)

DIRECT, HORIZON = Parameterization("direct"), Parameterization("horizon")
ALL = [
    Parameterization(name, family)
    for name in ("direct", "horizon", "undistorted_horizon")
    for family in ("lopez", "zero")
]
TRUTH = CameraParameters(
    *(torch.tensor([v], dtype=torch.float64) for v in (math.radians(8), math.radians(5), 0.8, -0.2))
)
ASPECT = torch.tensor([4 / 3], dtype=torch.float64)
tilts, rolls, focals, k1s = st.floats(-1, 1), st.floats(-0.7, 0.7), st.floats(0.481, 1.407), st.floats(-0.4, 0.0)
errors = st.floats(-0.5, 0.5)


def camera(*values):
    return CameraParameters(*(torch.tensor([value], dtype=torch.float64) for value in values))


def paper_space(parameterization, dtype=torch.float64):
    """The paper's ranges, with rolls to 45 degrees, and tilts to 30 degrees or offsets to half a height."""
    roll = math.pi / 4
    if parameterization.name == "direct":
        low, high = [-math.pi / 6, -roll, 0.481, -0.4], [math.pi / 6, roll, 1.407, 0.0]
    else:
        vfovs = [2 * math.atan(0.5 / focal) for focal in (1.407, 0.481)]
        low, high = [-0.5, -roll, vfovs[0], -1.41], [0.5, roll, vfovs[1], 0.0]  # 0.5 % of k1_hat lie below
    return ParameterSpace(parameterization, torch.tensor(low, dtype=dtype), torch.tensor(high, dtype=dtype))


def loss(space, first, second, mode="joint", **more):
    chosen = BearingLoss(space, mode=mode, **more)
    encode = space.parameterization.encode
    return chosen(encode(first), encode(second), ASPECT)


def rays(truth):
    """Rays of the grid in the camera, by the camera class."""
    size = 3000, 2250
    lens = PerspectiveCamera.from_focal(truth.focal.squeeze(), *size, k1=truth.k1.squeeze())
    column, row = torch.meshgrid(torch.linspace(0, size[0], 7), torch.linspace(0, size[1], 7), indexing="xy")
    return lens.bearings(torch.stack([column, row], -1).reshape(-1, 2).double())


def test_the_grid_is_regular_and_reaches_the_edges():
    grid = bearing_grid(5, torch.tensor([1.0, 1.5]))
    assert grid.shape == (2, 25, 2)
    assert grid[1].amax(0).tolist() == [0.75, 0.5]
    assert grid[1].amin(0).tolist() == [-0.75, -0.5]
    torch.testing.assert_close(grid.mean(1), torch.zeros(2, 2))


def test_bearings_are_those_of_the_camera_turned_into_the_gravity_frame():
    found = world_bearings(TRUTH, HORIZON, bearing_grid(7, ASPECT))[0]
    torch.testing.assert_close(found.norm(dim=-1), torch.ones(49, dtype=torch.float64))
    tilt, roll = TRUTH.tilt.item(), TRUTH.roll.item()
    c, s = math.cos, math.sin
    about_x = torch.tensor([[1, 0, 0], [0, c(tilt), -s(tilt)], [0, s(tilt), c(tilt)]], dtype=torch.float64)
    about_z = torch.tensor([[c(roll), -s(roll), 0], [s(roll), c(roll), 0], [0, 0, 1]], dtype=torch.float64)
    torch.testing.assert_close(found, rays(TRUTH) @ (about_x @ about_z).T)
    # the middle of the image looks along the tilt: up is -y
    torch.testing.assert_close(found[24], torch.tensor([0, -math.sin(tilt), math.cos(tilt)], dtype=torch.float64))


@given(tilts, rolls, focals, k1s, errors)
def test_a_roll_error_costs_what_its_closed_form_says(tilt, roll, focal, k1, error):
    truth = camera(tilt, roll, focal, k1)
    expected = 4 * math.sin(error / 2) ** 2 * (1 - rays(truth)[:, 2] ** 2).mean()
    found = loss(paper_space(DIRECT), truth._replace(roll=truth.roll + error), truth)
    torch.testing.assert_close(found, expected[None], rtol=1e-9, atol=1e-14)


@given(tilts, rolls, focals, k1s, errors)
def test_a_tilt_error_costs_what_its_closed_form_says(tilt, roll, focal, k1, error):
    truth = camera(tilt, roll, focal, k1)
    across = world_bearings(truth, DIRECT, bearing_grid(7, ASPECT))[0, :, 0]
    expected = 4 * math.sin(error / 2) ** 2 * (1 - across**2).mean()
    found = loss(paper_space(DIRECT), truth._replace(tilt=truth.tilt + error), truth)
    torch.testing.assert_close(found, expected[None], rtol=1e-9, atol=1e-14)


@given(focals, k1s, focals, k1s)
def test_a_lens_error_costs_the_change_of_the_angle_to_the_axis(focal, k1, focal_wrong, k1_wrong):
    truth, wrong = camera(0.3, -0.2, focal, k1), camera(0.3, -0.2, focal_wrong, k1_wrong)
    # by atan2: the arc cosine would lose half of the digits next to the axis
    eta, eta_wrong = (torch.atan2(rays(each)[:, :2].norm(dim=-1), rays(each)[:, 2]) for each in (truth, wrong))
    expected = (4 * torch.sin((eta_wrong - eta) / 2) ** 2).mean()
    torch.testing.assert_close(loss(paper_space(DIRECT), wrong, truth), expected[None], rtol=1e-9, atol=1e-14)


@pytest.mark.slow
@given(tilts, rolls, focals, k1s, st.sampled_from(ALL[:1] + ALL[2:3]))
def test_losses_are_positive_symmetric_and_0_at_the_truth(tilt, roll, focal, k1, parameterization):
    truth = camera(tilt, roll, focal, k1)
    space = paper_space(parameterization)
    for mode in ("joint", "disentangled", "harmonic"):
        assert loss(space, truth, truth, mode).item() < 1e-25
        assert loss(space, TRUTH, truth, mode).item() >= 0
    torch.testing.assert_close(loss(space, TRUTH, truth), loss(space, truth, TRUTH))


def test_the_joint_loss_is_of_cameras_whatever_the_numbers_are():
    wrong = camera(0.1, 0.2, 0.7, -0.1)
    found = [loss(paper_space(each), wrong, TRUTH) for each in ALL if each.k2_of_k1 == "lopez"]
    torch.testing.assert_close(found[0], found[1])
    torch.testing.assert_close(found[0], found[2])


def test_the_disentangled_loss_is_the_mean_of_four_joint_losses_with_one_number_wrong():
    space, wrong = paper_space(HORIZON), camera(0.1, 0.2, 0.7, -0.1)
    numbers, true_numbers = HORIZON.encode(wrong), HORIZON.encode(TRUTH)
    parts = []
    for i in range(4):
        mixed = true_numbers.clone()
        mixed[:, i] = numbers[:, i]
        parts.append(BearingLoss(space, mode="joint")(mixed, true_numbers, ASPECT))
    torch.testing.assert_close(loss(space, wrong, TRUTH, "disentangled"), torch.stack(parts).mean(0))
    weights = harmonic_weights(space)
    expected = (torch.stack(parts, -1) * weights).sum(-1)
    torch.testing.assert_close(loss(space, wrong, TRUTH, "harmonic"), expected, rtol=1e-6, atol=0)


def bias(mode, parameterization, number, error):
    """The other three numbers that the loss asks for when one is wrong by ``error``, less the true ones."""
    space = paper_space(parameterization)
    chosen, true_numbers = BearingLoss(space, mode=mode), parameterization.encode(TRUTH)
    free = [i for i in range(4) if i != number]
    width = (space.high - space.low)[free]

    def value_and_slope(step):
        step = torch.tensor(step, requires_grad=True)
        numbers = true_numbers.clone()
        numbers[0, number] += error
        numbers[0, free] += width * step
        value = 1e3 * chosen(numbers, true_numbers, ASPECT)
        (slope,) = torch.autograd.grad(value, step)
        return value.item(), slope.numpy()

    begin = [0.02, -0.02, 0.02]
    found = minimize(value_and_slope, begin, jac=True, method="BFGS", options={"gtol": 1e-10, "maxiter": 500})
    out = torch.zeros(4, dtype=torch.float64)
    out[free] = torch.from_numpy(found.x) * width
    return out


@pytest.mark.parametrize(
    ("parameterization", "number", "error"),
    [
        (HORIZON, 0, 0.05),
        (HORIZON, 2, 0.09),
        (HORIZON, 2, -0.09),
        (HORIZON, 3, 0.1),
        (DIRECT, 2, 0.1),
        (DIRECT, 3, 0.1),
    ],
)
def test_the_disentangled_loss_has_no_bias_where_the_joint_one_has(parameterization, number, error):
    width = paper_space(parameterization).high - paper_space(parameterization).low
    joint, apart = (bias(mode, parameterization, number, error) for mode in ("joint", "disentangled"))
    assert (joint / width).abs().max() > 0.01
    assert (apart / width).abs().max() < 1e-5


@pytest.mark.slow
def test_the_joint_loss_asks_for_the_biases_of_the_cross_talk_table():
    five = math.radians(5)
    wide, narrow = bias("joint", HORIZON, 2, five), bias("joint", HORIZON, 2, -five)
    bent, low = bias("joint", HORIZON, 3, 0.1), bias("joint", HORIZON, 0, 0.05)
    assert wide[3].item() == pytest.approx(0.108, abs=5e-3)
    assert wide[0].item() == pytest.approx(-0.010, abs=3e-3)
    assert narrow[3].item() == pytest.approx(-0.140, abs=5e-3)
    assert math.degrees(bent[2]) == pytest.approx(3.2, abs=0.1)
    assert math.degrees(low[2]) == pytest.approx(-5.9, abs=0.3)
    assert low[3].item() == pytest.approx(-0.170, abs=1e-2)


def test_harmonic_weights_are_the_inverse_of_what_each_number_costs_over_its_range():
    space = paper_space(HORIZON)
    weights = harmonic_weights(space)
    assert weights.sum().item() == pytest.approx(1)
    middle = (space.low + space.high) / 2
    cost = []
    for i in range(4):
        numbers = middle.repeat(1001, 1)
        numbers[:, i] = torch.linspace(space.low[i], space.high[i], 1001, dtype=torch.float64)
        grid = bearing_grid(7, ASPECT.expand(1001))
        cost.append(bearing_difference(numbers, middle.expand(1001, 4), HORIZON, grid).mean().item())
    pace = weights * torch.tensor(cost, dtype=torch.float64)
    torch.testing.assert_close(pace / pace.mean(), torch.ones(4, dtype=torch.float64), rtol=0.05, atol=0)


@pytest.mark.parametrize(
    ("parameterization", "expected", "factor"),
    [(DIRECT, [0.017, 0.023, 0.058, 0.901], 1.5), (HORIZON, [0.035, 0.053, 0.136, 0.776], 1.5)],
)
def test_harmonic_weights_are_near_those_of_the_design(parameterization, expected, factor):
    weights = harmonic_weights(paper_space(parameterization)).tolist()
    for found, near in zip(weights, expected, strict=True):
        assert near / factor < found < near * factor
    assert weights == sorted(weights)


def test_a_number_that_never_changes_takes_no_weight_from_the_others():
    space = paper_space(HORIZON)
    high = space.high.clone()
    low = torch.cat([space.low[:3], torch.tensor([-2e-5], dtype=torch.float64)])
    high[3] = 2e-5
    weights = harmonic_weights(ParameterSpace(HORIZON, low, high))
    assert weights[3] == 0
    assert (weights[:3] > 0.01).all()
    still = ParameterSpace(HORIZON, middle := torch.tensor([0.0, 0.0, 1.0, 0.0]), middle + 1e-6)
    assert harmonic_weights(still).tolist() == [0.25] * 4


@pytest.mark.parametrize("parameterization", ALL, ids=lambda p: f"{p.name}-{p.k2_of_k1}")
@pytest.mark.parametrize("mode", ["joint", "disentangled", "harmonic"])
def test_gradients_are_those_of_finite_differences(parameterization, mode):
    truth = CameraParameters(
        *(torch.tensor(v, dtype=torch.float64) for v in ([0.2, -0.3], [0.1, 0.0], [0.9, 1.1], [-0.08, -0.05]))
    )
    wrong = CameraParameters(
        *(torch.tensor(v, dtype=torch.float64) for v in ([0.1, -0.5], [0.0, 0.3], [1.0, 0.9], [-0.05, -0.04]))
    )
    chosen = BearingLoss(paper_space(parameterization), mode=mode, grid=3)
    numbers = parameterization.encode(wrong).requires_grad_()
    aspect = torch.tensor([1.0, 1.5], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda values: chosen(values, parameterization.encode(truth), aspect), [numbers])


@pytest.mark.parametrize("parameterization", ALL, ids=lambda p: f"{p.name}-{p.k2_of_k1}")
def test_gradients_are_finite_for_whatever_a_network_says_in_half_or_single_precision(parameterization):
    space = paper_space(parameterization, torch.float32)
    generator = torch.Generator().manual_seed(0)
    unit = torch.cat([torch.cartesian_prod(*[torch.tensor([0.0, 1.0])] * 4), torch.rand(50, 4, generator=generator)])
    truth = space.from_unit(torch.rand(len(unit), 4, generator=generator))
    aspect = torch.full((len(unit),), 4 / 3)
    for mode in ("joint", "disentangled", "harmonic"):
        said = space.from_unit(unit).requires_grad_()
        value = BearingLoss(space, mode=mode)(said, truth, aspect)
        (gradient,) = torch.autograd.grad(value.sum(), said)
        assert value.dtype == torch.float32
        assert value.isfinite().all()
        assert gradient.isfinite().all()
        rounded = BearingLoss(space, mode=mode)(said.bfloat16(), truth, aspect)
        assert rounded.dtype == torch.float32


def test_mixed_precision_does_not_round_the_loss():
    space = paper_space(HORIZON, torch.float32)
    said, truth = space.from_unit(torch.full((3, 4), 0.4)), space.from_unit(torch.full((3, 4), 0.5))
    chosen = BearingLoss(space)
    expected = chosen(said, truth, torch.ones(3))
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(chosen(said, truth, torch.ones(3)), expected)


def test_images_of_a_batch_do_not_touch_each_other():
    space = paper_space(HORIZON)
    numbers = space.from_unit(torch.rand(5, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64))
    aspect = torch.tensor([1.0, 4 / 3, 1.5, 16 / 9, 1.25], dtype=torch.float64)
    chosen = BearingLoss(space, mode="disentangled")
    together = chosen(numbers, numbers.flip(0), aspect)
    alone = [chosen(numbers[i : i + 1], numbers.flip(0)[i : i + 1], aspect[i : i + 1]) for i in range(5)]
    torch.testing.assert_close(together, torch.cat(alone))
    assert one_at_a_time(numbers, numbers, HORIZON, bearing_grid(7, aspect)).abs().max() < 1e-25


@pytest.mark.parametrize("kind", [BearingLoss, ParameterLoss, PoseLensLoss])
@pytest.mark.parametrize("shapes", [((2, 4), (2, 4), (2, 1)), ((2, 1), (2, 4), (2,)), ((2, 4), (2, 4), (1,))])
def test_shapes_of_no_batch_are_refused_as_they_would_broadcast(kind, shapes):
    with pytest.raises(ArgumentError, match=r"(predicted|aspect) has the shape .* but must have"):
        kind(paper_space(HORIZON))(*(torch.ones(shape) for shape in shapes))


def test_weights_are_no_part_of_a_checkpoint():
    assert BearingLoss(paper_space(HORIZON), mode="harmonic").state_dict() == {}


def test_vfov_at_fixed_rho_moves_the_tilt_as_well():
    numbers = HORIZON.encode(TRUTH)
    wider = numbers.clone()
    wider[:, 2] += 0.1
    camera_wider = HORIZON.decode(wider)
    assert camera_wider.tilt.item() > TRUTH.tilt.item() + 0.01
    assert vfov_from_focal(camera_wider.focal).item() == pytest.approx(vfov_from_focal(TRUTH.focal).item() + 0.1)
