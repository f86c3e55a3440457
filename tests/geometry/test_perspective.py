"""The perspective camera against the pinhole matrix and the scalar formulas, and there and back."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.geometry import (
    PerspectiveCamera,
    heights_from_pixels,
    k2_of_k1,
    perspective_bearings,
    perspective_project,
    pixels_from_heights,
)


@pytest.fixture(autouse=True)
def _float64():
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@st.composite
def cameras(draw):
    width, height = draw(st.tuples(st.integers(1, 40), st.integers(1, 40)))
    focal = draw(st.floats(0.45, 3.0)) * max(1, width / height)
    return PerspectiveCamera.from_focal(focal, width, height, k1=draw(st.floats(-0.4, 0.2)))


@given(cameras())
def test_the_pixel_of_a_pixels_ray_is_the_pixel(camera):
    centres = camera.pixel_centres()
    bearings = camera.bearings(centres)
    torch.testing.assert_close(bearings.norm(dim=-1), torch.ones_like(bearings[..., 0]))
    assert (bearings[..., 2] > 0).all()
    pixels, visible = camera.project(bearings * 3.7)
    assert visible.all()
    assert camera.contains(pixels).all()
    torch.testing.assert_close(pixels, centres, rtol=0, atol=1e-10)


@given(st.floats(50, 500), st.integers(0, 99))
def test_without_distortion_it_is_the_camera_matrix(focal_px, seed):
    points = np.random.default_rng(seed).uniform([-3, -3, 1], [3, 3, 7], size=(7, 3))
    matrix = np.array([[focal_px, 0, 320], [0, focal_px, 240], [0, 0, 1]])
    expected = points @ matrix.T
    camera = PerspectiveCamera.from_focal_pixels(focal_px, 640, 480)
    pixels, visible = camera.project(torch.from_numpy(points))
    assert visible.all()
    np.testing.assert_allclose(pixels, expected[:, :2] / expected[:, 2:], rtol=1e-12)
    rays = np.linalg.solve(matrix, np.array([17.0, 33.0, 1.0]))
    np.testing.assert_allclose(camera.bearings(torch.tensor([17.0, 33.0])), rays / np.linalg.norm(rays), rtol=1e-12)


def test_projection_is_the_equation():
    camera = PerspectiveCamera.from_focal(0.7, 400, 300, k1=-0.2, k2=0.05)
    x, y = 0.3, -0.4
    d = 1 - 0.2 * 0.25 + 0.05 * 0.0625
    pixel, _ = camera.project(torch.tensor([2 * x, 2 * y, 2]))
    assert pixel.tolist() == pytest.approx([200 + 300 * 0.7 * d * x, 150 + 300 * 0.7 * d * y])


@pytest.mark.parametrize("k1", [-0.3, 0.0, 0.2])
def test_the_axes_are_right_down_and_forward(k1):
    camera = PerspectiveCamera.from_focal(0.9, 64, 48, k1=k1)
    centre, right, below = camera.bearings(torch.tensor([[32.0, 24.0], [50.0, 24.0], [32.0, 40.0]]))
    assert centre.tolist() == [0, 0, 1]
    assert right[0] > 0
    assert right[1] == 0
    assert below[1] > 0
    assert below[0] == 0


def test_behind_the_camera_and_beyond_the_fold_nothing_is_seen_and_gradients_stay_finite():
    camera = PerspectiveCamera.from_focal(2.0, 64, 48, k1=-0.4, family="zero")  # folds at 42.4 degrees
    angles = torch.deg2rad(torch.tensor([0.0, 42.0, 43.0, 89.0, 90.0, 120.0, 180.0]))
    directions = torch.stack([angles.sin(), 0 * angles, angles.cos()], dim=-1).requires_grad_()
    pixels, visible = camera.project(directions)
    assert visible.tolist() == [True, True, False, False, False, False, False]
    assert pixels.isfinite().all()
    assert torch.autograd.grad(pixels.sum(), directions)[0].isfinite().all()
    _, visible = camera.project(torch.zeros(3))
    assert not visible


def test_a_batch_of_cameras_is_each_camera_by_itself():
    focal, k1 = torch.tensor([0.8, 1.0, 1.5]), torch.tensor([-0.3, 0.0, 0.1])
    batch = PerspectiveCamera.from_focal(focal, 3, 3, k1=k1)  # as many cameras as rows and columns
    singles = [PerspectiveCamera.from_focal(f, 3, 3, k1=k) for f, k in zip(focal, k1, strict=True)]
    centres = batch.pixel_centres()
    assert centres.shape == (1, 3, 3, 2)
    bearings = batch.bearings(centres)
    assert torch.equal(bearings, torch.stack([single.bearings(single.pixel_centres()) for single in singles]))
    pixels, visible = batch.project(bearings)
    assert visible.all()
    torch.testing.assert_close(pixels, centres.expand(3, 3, 3, 2))
    assert torch.equal(batch.true_vfov, torch.stack([single.true_vfov for single in singles]))
    shared = PerspectiveCamera.from_focal(focal, 3, 3, k1=-0.1)
    assert shared.batch_shape == (3,)
    assert shared.bearings(centres).shape == (3, 3, 3, 3)
    with pytest.raises(ValueError, match="batch"):
        batch.bearings(torch.zeros(2))


@pytest.mark.parametrize(("focal", "k1", "nominal", "true"), [(0.5, -0.4, 90.0, 110.6), (1.0, -0.2, 53.1, 55.7)])
def test_fields_of_view(focal, k1, nominal, true):
    camera = PerspectiveCamera.from_focal(focal, 640, 480, k1=k1)
    assert math.degrees(camera.vfov) == pytest.approx(nominal, abs=0.05)
    assert math.degrees(camera.true_vfov) == pytest.approx(true, abs=0.05)
    top, bottom = camera.bearings(torch.tensor([[320.0, 0.0], [320.0, 480.0]]))
    assert torch.acos(top @ bottom).item() == pytest.approx(camera.true_vfov.item())


@given(st.floats(0.2, 2.5))
def test_a_camera_is_made_from_its_field_of_view_or_focal_length(vfov):
    by_number = PerspectiveCamera.from_vfov(vfov, 64, 48, k1=-0.1)
    by_tensor = PerspectiveCamera.from_vfov(torch.tensor(vfov), 64, 48, k1=-0.1)
    by_focal = PerspectiveCamera.from_focal_pixels(48 * by_number.focal, 64, 48, k1=-0.1, family="lopez")
    for camera in (by_number, by_tensor, by_focal):
        assert camera.vfov.item() == pytest.approx(vfov)
        torch.testing.assert_close(camera.k2, k2_of_k1(camera.k1))


def test_numbers_take_the_type_of_the_tensors():
    camera = PerspectiveCamera.from_focal(1.0, 4, 4, k1=torch.tensor(-0.1, dtype=torch.float32))
    assert {camera.focal.dtype, camera.k2.dtype, camera.pixel_centres().dtype} == {torch.float32}
    assert camera.bearings(camera.pixel_centres()).dtype == torch.float32
    moved = camera.to(dtype=torch.float64)
    assert moved.dtype == torch.float64
    assert (moved.width, moved.height) == (4, 4)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"focal": 0.0}, "got focal=0"),
        ({"focal": -1.0}, "got focal=-1"),
        ({"focal": torch.tensor([1.0, math.nan])}, "got focal=nan"),
        ({"focal": math.inf}, "got focal=inf"),
        ({"k1": math.nan}, "got k1=nan"),
        ({"k2": math.inf}, "got k2=inf"),
        ({"width": 0}, "width=0"),
        ({"height": -1}, "height=-1"),
        ({"focal": 0.5, "k1": -0.4, "family": "zero"}, r"corners of a 64x48 image lie beyond(.|\n)*focal >= 1.3694"),
        ({"focal": torch.tensor([2.0, 1.0]), "k1": -0.4, "family": "zero"}, "focal=1, k1=-0.4, k2=0"),
    ],
)
def test_impossible_cameras_are_refused_with_a_reason(changed, says):
    values = {"focal": 1.0, "width": 64, "height": 48} | changed
    with pytest.raises(UserError, match=says):
        PerspectiveCamera.from_focal(**values)


@pytest.mark.parametrize("vfov", [0.0, math.pi, -1.0, math.nan])
def test_impossible_fields_of_view_are_refused(vfov):
    with pytest.raises(UserError, match="vfov lies between 0 and pi"):
        PerspectiveCamera.from_vfov(vfov, 64, 48)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("k1", [-0.2, 0.0, 0.3])
def test_directions_beside_the_camera_are_not_seen_and_finite(dtype, k1):
    depth = torch.tensor([1e-3, 1e-6, 1e-12, 1e-30, 0.0, -1e-30], dtype=dtype)
    directions = torch.stack([torch.ones_like(depth), -torch.ones_like(depth), depth], -1).requires_grad_()
    points, visible = perspective_project(directions, *torch.tensor([1.0, k1, 0.805 * k1 * k1], dtype=dtype))
    assert visible[0]
    assert not visible[3:].any()
    assert points.isfinite().all()
    (gradient,) = torch.autograd.grad(points.sum(), directions)
    assert gradient.isfinite().all()


def test_the_focal_length_that_the_error_names_is_accepted_and_no_less():
    PerspectiveCamera.from_focal(1.3694, 64, 48, k1=-0.4, family="zero")
    with pytest.raises(UserError):
        PerspectiveCamera.from_focal(1.369, 64, 48, k1=-0.4, family="zero")


def test_gradients_are_those_of_finite_differences_at_the_centre_too():
    points = torch.tensor([[0.0, 0.0], [0.3, -0.2], [-0.5, 0.4]], requires_grad=True)
    focal, k1, k2 = (torch.tensor(value, requires_grad=True) for value in (0.7, -0.3, 0.06))
    assert torch.autograd.gradcheck(perspective_bearings, [points, focal, k1, k2])
    assert torch.autograd.gradgradcheck(perspective_bearings, [points, focal, k1, k2])
    rays = perspective_bearings(points, focal, k1, k2).detach().requires_grad_()
    assert torch.autograd.gradcheck(lambda *values: perspective_project(*values)[0], [rays, focal, k1, k2])


def test_the_angle_of_a_ray_changes_with_focal_length_and_distortion_as_the_closed_forms_say():
    radius, (focal, k1) = 0.45, (torch.tensor(value, requires_grad=True) for value in (0.6, -0.25))
    x, _, z = perspective_bearings(torch.tensor([radius, 0.0]), focal, k1, k2_of_k1(k1)).unbind(-1)
    by_focal, by_k1 = torch.autograd.grad(torch.atan2(x, z), [focal, k1])
    r = x / z
    slope, k2_slope = 1 + 3 * k1 * r**2 + 5 * k2_of_k1(k1) * r**4, 0.019 + 1.61 * k1
    torch.testing.assert_close(by_focal, -(radius / focal**2) / (slope * (1 + r**2)))
    torch.testing.assert_close(by_k1, -(r**3) * (1 + k2_slope * r**2) / (slope * (1 + r**2)))


def test_image_coordinates_in_heights_have_their_origin_at_the_centre():
    pixels = torch.tensor([[0.0, 0.0], [320.0, 240.0], [640.0, 480.0], [320.5, 0.5]])
    heights = heights_from_pixels(pixels, 640, 480)
    torch.testing.assert_close(heights[:3], torch.tensor([[-2 / 3, -0.5], [0.0, 0.0], [2 / 3, 0.5]]))
    torch.testing.assert_close(pixels_from_heights(heights, 640, 480), pixels)
