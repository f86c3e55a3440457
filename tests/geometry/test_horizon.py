"""The horizon's offset against a search along the horizon that the camera sees."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.geometry import (
    EquirectangularCamera,
    PerspectiveCamera,
    heights_from_pixels,
    horizon_foot,
    horizon_line,
    horizon_points,
    k2_of_k1,
    rho_from_tilt,
    tau_from_tilt,
    tilt_from_rho,
    tilt_from_tau,
)

tilts, rolls, focals, k1s = st.floats(-1.0, 1.0), st.floats(-0.7, 0.7), st.floats(0.481, 1.407), st.floats(-0.4, 0.2)
AZIMUTHS = torch.linspace(-1.5, 1.5, 30001, dtype=torch.float64)


def f64(*values):
    return [torch.tensor(value, dtype=torch.float64) for value in values]


def horizon_in_heights(focal, k1, tilt, roll):
    camera = PerspectiveCamera.from_focal(focal, 48, 48, k1=k1)
    pixels, visible = horizon_points(camera, tilt, roll, AZIMUTHS)
    return heights_from_pixels(pixels[visible], 48, 48)


@given(tilts, focals, k1s)
def test_offsets_and_tilt_there_and_back(tilt, focal, k1):
    tilt, focal, k1 = f64(tilt, focal, k1)
    k2 = k2_of_k1(k1)
    rho, tau = rho_from_tilt(tilt, focal, k1, k2), tau_from_tilt(tilt, focal)
    torch.testing.assert_close(tilt_from_rho(rho, focal, k1, k2), tilt, rtol=0, atol=1e-14)
    torch.testing.assert_close(tilt_from_tau(tau, focal), tilt, rtol=0, atol=1e-15)
    torch.testing.assert_close(rho_from_tilt(tilt, focal, 0 * k1, 0 * k1), tau)
    assert rho * tilt >= 0


@given(tilts, rolls, focals, k1s)
def test_the_foot_is_the_point_of_the_visible_horizon_nearest_to_the_centre(tilt, roll, focal, k1):
    tilt, roll, focal, k1 = f64(tilt, roll, focal, k1)
    curve = horizon_in_heights(focal, k1, tilt, roll)
    rho = rho_from_tilt(tilt, focal, k1, k2_of_k1(k1))
    distances = curve.norm(dim=-1)
    nearest = distances.argmin()
    torch.testing.assert_close(curve[nearest], horizon_foot(rho, roll), rtol=0, atol=1e-3)
    torch.testing.assert_close(distances[nearest], rho.abs(), rtol=0, atol=1e-7)


@given(tilts, rolls, focals)
def test_without_distortion_the_horizon_is_the_line(tilt, roll, focal):
    tilt, roll, focal = f64(tilt, roll, focal)
    line = horizon_line(tau_from_tilt(tilt, focal), roll)
    curve = horizon_in_heights(focal, torch.zeros_like(focal), tilt, roll)
    near = curve[curve.norm(dim=-1) < 3]
    distance = near @ line[:2] + line[2]
    torch.testing.assert_close(distance, torch.zeros_like(distance), rtol=0, atol=1e-12)


def test_a_camera_that_looks_up_sees_the_horizon_below_its_centre_and_the_ground_below_that():
    tau = tau_from_tilt(*f64(0.2, 0.8))
    assert tau > 0
    line, below = horizon_line(tau, torch.zeros_like(tau)), tau.new_tensor([0.3, 0.9, 1.0])
    assert line @ below > 0


def test_a_panorama_sees_a_level_horizon_along_its_middle_row():
    azimuths = torch.linspace(-3, 3, 7, dtype=torch.float64)
    pixels, visible = horizon_points(EquirectangularCamera(360, 180), *f64(0.0, 0.0), azimuths)
    assert visible.all()
    torch.testing.assert_close(pixels[:, 1], torch.full_like(azimuths, 90))
    torch.testing.assert_close(pixels[:, 0], 180 + torch.rad2deg(azimuths))


def test_a_batch_of_cameras_has_a_horizon_each():
    focal, tilt, roll = f64([0.7, 1.1], [0.1, -0.2], [0.3, 0.0])
    camera = PerspectiveCamera.from_focal(focal, 48, 48, k1=-0.2)
    pixels, visible = horizon_points(camera, tilt, roll, AZIMUTHS)
    assert pixels.shape == (2, 30001, 2)
    assert visible.shape == (2, 30001)
    for index in (0, 1):
        single = PerspectiveCamera.from_focal(focal[index], 48, 48, k1=-0.2)
        torch.testing.assert_close(pixels[index], horizon_points(single, tilt[index], roll[index], AZIMUTHS)[0])


def test_an_offset_out_of_reach_is_the_tilt_of_the_fold():
    tilt = tilt_from_rho(*f64(5.0, 1.0, -0.4, 0.0))
    assert math.degrees(tilt) == pytest.approx(42.4, abs=0.05)


def test_derivatives_are_the_closed_forms():
    tilt, focal, k1 = (value.requires_grad_() for value in f64(0.5, 0.8, -0.3))
    k2, k2_slope = k2_of_k1(k1), 0.019 + 1.61 * k1
    rho, t = rho_from_tilt(tilt, focal, k1, k2), torch.tan(tilt)
    slope = 1 + 3 * k1 * t**2 + 5 * k2 * t**4
    by_tilt, by_focal, by_k1 = torch.autograd.grad(rho, [tilt, focal, k1], retain_graph=True)
    torch.testing.assert_close(by_tilt, focal * (1 + t**2) * slope)
    torch.testing.assert_close(by_focal, rho / focal)
    torch.testing.assert_close(by_k1, focal * t**3 * (1 + k2_slope * t**2))
    inputs = [rho.detach().requires_grad_(), focal, k1]
    assert torch.autograd.gradcheck(lambda r, f, k: tilt_from_rho(r, f, k, k2_of_k1(k)), inputs)
