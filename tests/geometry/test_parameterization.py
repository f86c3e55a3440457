"""What a network predicts: there and back, its Jacobians, and why distortion is divided by the squared focal length."""

import math
from itertools import pairwise

import pytest
import torch

from sextant.errors import UserError
from sextant.geometry import (
    CameraParameters,
    Parameterization,
    ParameterSpace,
    PerspectiveCamera,
    focal_from_vfov,
    max_radius,
    rho_from_tilt,
    tau_from_tilt,
    vfov_from_focal,
)

NAMES = ["direct", "angles", "horizon", "undistorted_horizon"]
FAMILIES = ["lopez", "zero"]
ALL = [(name, family) for name in NAMES for family in FAMILIES]


def f64(*values):
    return [torch.tensor(value, dtype=torch.float64) for value in values]


def cameras(count, family, dtype=torch.float64, max_tilt_deg=80.0):
    """Cameras that a lens of the family can have; tilts below the fold."""
    generator = torch.Generator().manual_seed(3)
    low = torch.tensor([-math.radians(max_tilt_deg), -math.pi / 2, 0.3, -0.4], dtype=dtype)
    high = torch.tensor([math.radians(max_tilt_deg), math.pi / 2, 2.5, 0.2], dtype=dtype)
    tilt, roll, focal, k1 = (low + (high - low) * torch.rand(count, 4, generator=generator, dtype=dtype)).unbind(-1)
    fold = torch.atan(max_radius(k1, Parameterization("direct", family).k2(k1)))
    # next to the fold the tilt is a root of the offset, and half of its digits are lost whatever the method
    return CameraParameters(torch.minimum(tilt.abs(), 0.95 * fold).copysign(tilt), roll, focal, k1)


@pytest.mark.parametrize(("name", "family"), ALL)
def test_cameras_there_and_back(name, family):
    space = Parameterization(name, family)
    truth = cameras(20_000, family)
    for there, back in zip(truth, space.decode(space.encode(truth)), strict=True):
        torch.testing.assert_close(back, there, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "family"), ALL)
def test_numbers_there_and_back(name, family):
    space = Parameterization(name, family)
    numbers = space.encode(cameras(2000, family))
    torch.testing.assert_close(space.encode(space.decode(numbers)), numbers, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(("name", "family"), ALL)
def test_single_precision_keeps_its_type_and_its_digits(name, family):
    space = Parameterization(name, family)
    truth = cameras(2000, family, torch.float32, max_tilt_deg=60.0)
    for there, back in zip(truth, space.decode(space.encode(truth)), strict=True):
        assert back.dtype == torch.float32
        torch.testing.assert_close(back, there, rtol=0, atol=2e-5)


@pytest.mark.parametrize(("name", "family"), ALL)
def test_gradients_are_those_of_finite_differences(name, family):
    space = Parameterization(name, family)
    truth = CameraParameters(*f64([0.3, -0.5, 0.0], [0.1, 0.0, -0.4], [0.6, 1.1, 0.9], [-0.2, -0.05, 0.1]))
    inputs = [value.requires_grad_() for value in truth]
    assert torch.autograd.gradcheck(lambda *camera: space.encode(CameraParameters(*camera)), inputs)
    numbers = space.encode(truth).detach().requires_grad_()
    assert torch.autograd.gradcheck(lambda values: tuple(space.decode(values)), [numbers])
    assert torch.autograd.gradgradcheck(lambda values: tuple(space.decode(values)), [numbers])


def test_the_jacobians_are_the_closed_forms():
    camera = CameraParameters(*f64([0.3, -0.6, 0.9], [0.1, 0.2, 0.0], [0.5, 0.8, 1.3], [-0.4, -0.2, 0.1]))
    tilt, _, f, k1 = camera
    t, slope_k2 = torch.tan(tilt), 0.019 + 1.61 * k1
    slope = 1 + 3 * k1 * t**2 + 5 * (0.019 * k1 + 0.805 * k1**2) * t**4
    space = Parameterization("horizon")
    rows = torch.func.vmap(torch.func.jacfwd(lambda values: space.encode(CameraParameters(*values))))
    jacobian = rows(torch.stack(list(camera), -1))  # (b, number, tilt roll focal k1)
    rho, zero = space.encode(camera)[:, 0], torch.zeros_like(f)
    expected = [
        [f * (1 + t**2) * slope, zero, rho / f, f * t**3 * (1 + slope_k2 * t**2)],
        [zero, zero + 1, zero, zero],
        [zero, zero, -4 / (4 * f**2 + 1), zero],
        [zero, zero, -2 * k1 / f**3, 1 / f**2],
    ]
    torch.testing.assert_close(jacobian, torch.stack([torch.stack(row, -1) for row in expected], 1))


def test_at_fixed_rho_the_tilt_moves_with_field_of_view_and_distortion():
    space = Parameterization("horizon")
    camera = CameraParameters(*f64(0.4, 0.1, 0.7, -0.25))
    tilt, _, f, k1 = camera
    t, slope_k2 = torch.tan(tilt), 0.019 + 1.61 * k1
    slope = 1 + 3 * k1 * t**2 + 5 * (0.019 * k1 + 0.805 * k1**2) * t**4
    numbers = space.encode(camera)
    by_numbers = torch.autograd.functional.jacobian(lambda values: space.decode(values).tilt, numbers)
    # derived by hand from d rho = 0, with df/dF_v = -(4 f^2 + 1)/4 and dk1/df = 2 k1 / f at fixed k1 / f^2
    steep = f * (1 + t**2) * slope
    bent = t**3 * (1 + slope_k2 * t**2)
    by_vfov = (numbers[0] / f + 2 * (k1 / f) * f * bent) * (4 * f**2 + 1) / 4 / steep
    expected = torch.stack([1 / steep, 0 * f, by_vfov, -(f**3) * bent / steep])
    torch.testing.assert_close(by_numbers, expected)


def test_without_distortion_both_horizons_are_one_and_direct_is_the_camera():
    truth = cameras(50, "zero")._replace(k1=torch.zeros(50, dtype=torch.float64))
    horizon, undistorted = (Parameterization(name).encode(truth) for name in ("horizon", "undistorted_horizon"))
    torch.testing.assert_close(horizon, undistorted)
    torch.testing.assert_close(horizon[:, 0], truth.focal * torch.tan(truth.tilt))
    assert torch.equal(Parameterization("direct").encode(truth), torch.stack(list(truth), -1))


def test_the_numbers_are_what_the_horizon_and_the_field_of_view_are():
    truth = cameras(50, "lopez")
    space = Parameterization("horizon")
    rho, roll, vfov, k1_hat = space.encode(truth).unbind(-1)
    torch.testing.assert_close(rho, rho_from_tilt(truth.tilt, truth.focal, truth.k1, space.k2(truth.k1)))
    assert torch.equal(roll, truth.roll)
    torch.testing.assert_close(torch.tan(vfov / 2) * truth.focal, torch.full_like(rho, 0.5))
    torch.testing.assert_close(k1_hat * truth.focal**2, truth.k1)
    tau = Parameterization("undistorted_horizon").encode(truth)[:, 0]
    torch.testing.assert_close(tau, tau_from_tilt(truth.tilt, truth.focal))
    assert space.names == ("rho", "roll", "vfov", "k1_hat")
    assert Parameterization("undistorted_horizon").names[0] == "tau"


def test_field_of_view_and_focal_length_are_inverse():
    focal = torch.linspace(0.05, 20, 400, dtype=torch.float64)
    torch.testing.assert_close(focal_from_vfov(vfov_from_focal(focal)), focal)
    torch.testing.assert_close(vfov_from_focal(torch.tensor(0.5)), torch.tensor(math.pi / 2))


def bow(focal, k1):
    """How far, in heights, a straight vertical edge seen at u = 0.5 in the middle row departs from it, at most."""
    camera = PerspectiveCamera.from_focal(*f64(focal), 2000, 2000, k1=k1)
    middle = camera.bearings(torch.tensor([2000.0, 1000.0], dtype=torch.float64))
    x = middle[0] / middle[2]
    y = torch.linspace(0, 4, 40001, dtype=torch.float64)
    pixels, visible = camera.project(torch.stack([x.expand_as(y), y, torch.ones_like(y)], -1))
    u, v = (pixels[visible] / 2000 - torch.tensor([0.5, 0.5], dtype=torch.float64)).unbind(-1)
    return (0.5 - u[v <= 0.5]).abs().max().item()


def test_the_apparent_distortion_is_what_bends_lines_and_k1_is_not():
    focals = [0.5, 0.7, 1.0, 1.4]
    apparent = [bow(focal, -0.2 * focal**2) for focal in focals]
    assert apparent == pytest.approx([0.0311, 0.0298, 0.0291, 0.0288], abs=1e-4)
    assert max(apparent) / min(apparent) < 1.09
    plain = [bow(focal, -0.2) for focal in focals]
    assert plain == pytest.approx([0.050, 0.069, 0.029, 0.014], abs=1e-3)
    assert max(plain) / min(plain) > 4.5


@pytest.mark.parametrize(("name", "family"), ALL)
def test_whatever_a_bounded_network_says_is_a_camera_with_finite_gradients(name, family):
    truth = cameras(5000, family, torch.float32, max_tilt_deg=60.0)
    space = ParameterSpace.covering(Parameterization(name, family), truth)
    corners = torch.cartesian_prod(*[torch.tensor([0.0, 0.5, 1.0])] * 4)
    unit = torch.cat([corners, torch.rand(500, 4, generator=torch.Generator().manual_seed(0))]).requires_grad_()
    camera = space.parameterization.decode(space.from_unit(unit))
    assert all(value.isfinite().all() for value in camera)
    assert (camera.tilt.abs() < math.pi / 2).all()
    assert (camera.focal > 0).all()
    (gradient,) = torch.autograd.grad(sum(value.sum() for value in camera), unit)
    assert gradient.isfinite().all()


def test_an_offset_out_of_reach_gives_the_tilt_of_the_fold():
    space = Parameterization("horizon", "zero")
    camera = space.decode(torch.tensor([5.0, 0.0, math.pi / 2, -1.6], dtype=torch.float64))  # k1 = -0.4
    assert math.degrees(camera.tilt) == pytest.approx(42.4, abs=0.05)


@pytest.mark.parametrize(("name", "family"), ALL)
def test_a_covering_space_holds_its_cameras_with_little_room(name, family):
    truth = cameras(500, family)
    space = ParameterSpace.covering(Parameterization(name, family), truth, margin=0.02)
    unit = space.to_unit(space.parameterization.encode(truth))
    assert ((unit > 0) & (unit < 1)).all()
    torch.testing.assert_close(unit.amin(0), torch.full((4,), 0.02 / 1.04, dtype=unit.dtype), rtol=0, atol=1e-9)
    torch.testing.assert_close(space.from_unit(unit), space.parameterization.encode(truth))


@pytest.mark.parametrize("name", NAMES)
def test_a_covering_space_of_extreme_or_equal_cameras_is_legal(name):
    wide = CameraParameters(*f64([0.1, 0.2], [0.0, 0.1], [1e-4, 3.0], [0.0, -1e-9]))
    equal = CameraParameters(*f64([0.1, 0.1], [0.0, 0.0], [0.7, 0.7], [0.0, 0.0]))
    for truth in (wide, equal):
        space = ParameterSpace.covering(Parameterization(name), truth)
        focal = space.parameterization.decode(torch.stack([space.low, space.high])).focal
        assert (focal > 0).all()


def test_a_space_moves_without_changing():
    space = ParameterSpace.covering(Parameterization(), cameras(20, "lopez"))
    moved = space.to(torch.device("cpu"))
    assert torch.equal(moved.low, space.low)
    assert moved.parameterization == space.parameterization
    assert space.from_unit(torch.full((2, 4), 0.5)).dtype == torch.float32


def test_cameras_change_their_type_and_are_chosen():
    truth = cameras(10, "lopez")
    assert all(value.dtype == torch.float32 for value in truth.to(dtype=torch.float32))
    chosen = truth.at(torch.tensor([3, 1]))
    assert [value.tolist() for value in chosen] == [[value[3].item(), value[1].item()] for value in truth]
    assert all(torch.equal(a, b[2:4]) for a, b in zip(truth.at(slice(2, 4)), truth, strict=True))


def test_more_tilt_is_more_offset():
    tilts = torch.linspace(-1.2, 1.2, 101, dtype=torch.float64)
    for name in NAMES:
        others = (torch.full_like(tilts, value) for value in (0.0, 0.8, -0.3))
        offsets = Parameterization(name).encode(CameraParameters(tilts, *others))[:, 0]
        assert all(a < b for a, b in pairwise(offsets.tolist()))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"name": "rho"}, r"name='rho' must be one of direct, angles, horizon, undistorted_horizon"),
        ({"k2_of_k1": "free"}, "'free': a network predicts k1 alone"),
        ({"k2_of_k1": "cubic"}, "'cubic'"),
    ],
)
def test_what_is_no_parameterization_is_refused(arguments, says):
    with pytest.raises(UserError, match=says) as error:
        Parameterization(**arguments)
    assert error.value.fix


@pytest.mark.parametrize(
    ("name", "low", "high", "says"),
    [
        ("direct", [0.0, 0, 0.5, 0], [1.0, 1, 0.5, 1], "range of focal is empty"),
        ("direct", [0.0, 0, 0.0, 0], [1.0, 1, 1.0, 1], "range of focal, from 0 to 1, exceeds 0 to inf"),
        ("horizon", [0.0, 0, 0.5, 0], [1.0, 1, 3.2, 1], "range of vfov"),
        ("horizon", [0.0, 0, 0.5, math.nan], [1.0, 1, 1.0, 1], "range of k1_hat is empty or not finite"),
        ("undistorted_horizon", [0.0, 0, 0.5, 0], [math.inf, 1, 1.0, 1], "range of tau"),
        ("direct", [0.0, 0, 0.5], [1.0, 1, 0.7], r"low has the shape \(3,\), but must have \(4,\)"),
        ("direct", [0.0, 0, 0.5, 0], [1.0, 1, 0.7], r"high has the shape \(3,\)"),
    ],
)
def test_what_is_no_range_is_refused(name, low, high, says):
    with pytest.raises(UserError, match=says):
        ParameterSpace(Parameterization(name), torch.tensor(low), torch.tensor(high))
