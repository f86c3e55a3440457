"""Other programs' cameras against those programs, or against their documented equations written out here."""

import math

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.geometry import PerspectiveCamera, up_in_camera, vfov_from_focal
from sextant.geometry.conversions import (
    GeoCalibCamera,
    colmap_from_perspective,
    geocalib_from_perspective,
    opencv_from_perspective,
    opensfm_from_perspective,
    perspective_from_colmap,
    perspective_from_geocalib,
    perspective_from_opencv,
    perspective_from_opensfm,
)

CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
focals, k1s, sizes = st.floats(0.481, 2.0), st.floats(-0.4, 0.2), st.sampled_from([(640, 480), (480, 640), (333, 333)])


def make(focal, k1, size):
    return PerspectiveCamera.from_focal(torch.tensor(focal, dtype=torch.float64), *size, k1=k1)


def rays(limit=1.0, count=400):
    """Points at normalised radius up to ``limit``, as directions of varied depth."""
    rng = np.random.default_rng(1)
    angle, radius = rng.uniform(0, 2 * np.pi, count), np.sqrt(rng.uniform(0, limit**2, count))
    ideal = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(count)], -1)
    return ideal * rng.uniform(0.5, 5, (count, 1))


def batch():
    values = torch.linspace(0, 1, 7, dtype=torch.float64)
    return PerspectiveCamera.from_focal(0.5 + values, 640, 480, k1=0.1 - 0.4 * values.flip(0))


@given(focals, k1s, sizes)
def test_opencv_sees_points_at_the_same_pixels(focal, k1, size):
    camera = make(focal, k1, size)
    matrix, distortion = (value.numpy() for value in opencv_from_perspective(camera))
    points = rays()
    seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, distortion)
    ours, visible = camera.project(torch.from_numpy(points))
    assert visible.all()
    np.testing.assert_allclose(seen[:, 0] + 0.5, ours.numpy(), rtol=0, atol=1e-9)  # its centres are at integers


@given(focals, k1s, sizes)
def test_opencv_undistorts_pixels_to_the_same_rays(focal, k1, size):
    camera = make(focal, k1, size)
    matrix, distortion = (value.numpy() for value in opencv_from_perspective(camera))
    pixels, _ = camera.project(torch.from_numpy(rays()))
    bearings = camera.bearings(pixels)
    found = cv2.undistortPoints((pixels.numpy() - 0.5)[:, None], matrix, distortion, criteria=CRITERIA)[:, 0]
    ours = (bearings[:, :2] / bearings[:, 2:]).numpy()
    np.testing.assert_allclose(found, ours, rtol=0, atol=1e-12)


def test_opencv_by_default_is_not_accurate_enough_to_be_the_reference():
    camera = make(0.6, -0.4, (640, 480))
    matrix, distortion = (value.numpy() for value in opencv_from_perspective(camera))
    pixels, _ = camera.project(torch.from_numpy(rays()))
    found = cv2.undistortPoints((pixels.numpy() - 0.5)[:, None], matrix, distortion)[:, 0]
    points = rays()
    assert np.abs(found - points[:, :2] / points[:, 2:]).max() > 4e-3


def colmap_radial(parameters, points):
    """COLMAP's RADIAL model as its documentation gives it, in plain Python."""
    f, cx, cy, k1, k2 = parameters
    pixels = []
    for x, y, z in points:
        u, v = x / z, y / z
        r2 = u * u + v * v
        radial = k1 * r2 + k2 * r2 * r2
        pixels.append((f * (u + u * radial) + cx, f * (v + v * radial) + cy))
    return np.array(pixels)


@given(focals, k1s, sizes)
def test_colmap_sees_points_at_the_same_pixels(focal, k1, size):
    camera = make(focal, k1, size)
    parameters = colmap_from_perspective(camera).tolist()
    ours, _ = camera.project(torch.from_numpy(rays()))
    np.testing.assert_allclose(colmap_radial(parameters, rays().tolist()), ours.numpy(), rtol=0, atol=1e-9)
    # and back: its pixels are the rays they come from
    bearings = camera.bearings(torch.from_numpy(colmap_radial(parameters, rays().tolist()))).numpy()
    expected = rays() / np.linalg.norm(rays(), axis=-1, keepdims=True)
    np.testing.assert_allclose(bearings, expected, rtol=0, atol=1e-9)


@given(focals, k1s, sizes)
def test_opensfm_sees_points_at_the_same_pixels(focal, k1, size):
    camera = make(focal, k1, size)
    f, k1, k2 = opensfm_from_perspective(camera).tolist()
    points = rays()
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x * x + y * y
    normalised = f * (1 + r2 * (k1 + k2 * r2))[:, None] * np.stack([x, y], -1)
    width, height = size
    pixels = normalised * max(size) - 0.5 + np.array([width / 2, height / 2])  # OpenSfM's denormalised coordinates
    ours, _ = camera.project(torch.from_numpy(points))
    np.testing.assert_allclose(pixels + 0.5, ours.numpy(), rtol=0, atol=1e-9)


@given(focals, k1s, st.floats(-1.4, 1.4), st.floats(-1.5, 1.5))
def test_geocalib_has_the_same_gravity_and_its_k1_hat_is_ours(focal, k1, tilt, roll):
    camera = make(focal, k1, (640, 480))
    said = geocalib_from_perspective(camera, torch.tensor(tilt), torch.tensor(roll))
    # GeoCalib's Gravity.from_rp
    sr, cr, sp, cp = math.sin(said.roll), math.cos(said.roll), math.sin(said.pitch), math.cos(said.pitch)
    expected = torch.tensor([-sr * cp, -cr * cp, sp])
    torch.testing.assert_close(up_in_camera(torch.tensor(tilt), torch.tensor(roll)), expected)
    # its camera from vfov and k1_hat: f = h / 2 / tan(vfov / 2), k1 = k1_hat (f / h)^2
    f = 480 / 2 / math.tan(said.vfov / 2)
    assert f == pytest.approx(focal * 480)
    assert said.k1_hat.item() * (f / 480) ** 2 == pytest.approx(k1, abs=1e-12)
    torch.testing.assert_close(said.vfov, vfov_from_focal(camera.focal))


@pytest.mark.parametrize("program", ["opencv", "colmap", "opensfm", "geocalib"])
def test_a_batch_there_and_back(program):
    camera = batch()
    if program == "opencv":
        back = perspective_from_opencv(*opencv_from_perspective(camera), 640, 480)
    elif program == "colmap":
        back = perspective_from_colmap(colmap_from_perspective(camera), 640, 480)
    elif program == "opensfm":
        back = perspective_from_opensfm(opensfm_from_perspective(camera), 640, 480)
    else:
        tilt, roll = torch.linspace(-1, 1, 7), torch.tensor(0.3)
        back, tilt_back, roll_back = perspective_from_geocalib(geocalib_from_perspective(camera, tilt, roll), 640, 480)
        torch.testing.assert_close(tilt_back, tilt)
        torch.testing.assert_close(roll_back, roll.expand(7))
    assert back.batch_shape == (7,)
    assert (back.width, back.height) == (640, 480)
    for name in ("focal", "k1", "k2"):
        torch.testing.assert_close(getattr(back, name), getattr(camera, name), rtol=0, atol=1e-14)


def test_a_portrait_photo_has_its_longer_side_in_opensfm():
    camera = PerspectiveCamera.from_focal(1.0, 480, 640)
    assert opensfm_from_perspective(camera)[0].item() == 1.0
    assert opensfm_from_perspective(PerspectiveCamera.from_focal(1.0, 640, 480))[0].item() == 0.75
    assert perspective_from_opensfm(torch.tensor([0.75, 0.0, 0.0]), 640, 480).focal.item() == 1.0


def test_the_principal_points_differ_by_half_a_pixel():
    camera = PerspectiveCamera.from_focal(1.0, 640, 480, k1=-0.1)
    matrix, distortion = opencv_from_perspective(camera)
    assert matrix.tolist() == [[480, 0, 319.5], [0, 480, 239.5], [0, 0, 1]]
    assert distortion.shape == (5,)
    assert distortion[2:].tolist() == [0, 0, 0]
    assert colmap_from_perspective(camera)[:3].tolist() == [480, 320, 240]


def test_single_cameras_and_gradients_pass_through():
    values = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in (0.8, -0.2, 0.02)]

    def convert(focal, k1, k2):
        camera = PerspectiveCamera(focal, k1, k2, 64, 48)
        said = geocalib_from_perspective(camera, torch.zeros(()), torch.zeros(()))
        return (*opencv_from_perspective(camera), colmap_from_perspective(camera), opensfm_from_perspective(camera),
                said.vfov, said.k1_hat)  # fmt: skip

    assert torch.autograd.gradcheck(convert, values)


def near_opencv(**changes):
    matrix = torch.tensor([[500.0, 0, 319.5], [0, 500.0, 239.5], [0, 0, 1]], dtype=torch.float64)
    distortion = torch.tensor([-0.1, 0.01, 0, 0, 0], dtype=torch.float64)
    for (i, j), value in changes.get("matrix", {}).items():
        matrix[i, j] = value
    for i, value in changes.get("distortion", {}).items():
        distortion[i] = value
    return matrix, distortion


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"matrix": {(0, 2): 320.0}}, r"principal point lies \(0\.5, 0\) pixels from the image centre"),
        ({"matrix": {(1, 2): 250.0}}, "principal point"),
        ({"matrix": {(1, 1): 510.0}}, "fx - fy must be 0, got -10"),
        ({"matrix": {(0, 1): 1.0}}, "skew"),
        ({"matrix": {(2, 2): 2.0}}, "lower triangle"),
        ({"matrix": {(0, 2): math.nan}}, "principal point"),
        ({"matrix": {(0, 0): -500.0, (1, 1): -500.0}}, "focal is a positive"),
        ({"distortion": {2: 1e-3}}, "distortion coefficient p1 must be 0, got 0.001"),
        ({"distortion": {4: 0.1}}, "distortion coefficient k3"),
        ({"distortion": {0: -2.0, 1: 0.0}}, "folds the image over"),
    ],
)
def test_what_no_camera_here_can_be_is_refused(changes, says):
    with pytest.raises(UserError, match=says):
        perspective_from_opencv(*near_opencv(**changes), 640, 480)


def test_the_tolerance_takes_the_nearest_camera():
    matrix, distortion = near_opencv(matrix={(0, 2): 322.0, (1, 1): 504.0})
    camera = perspective_from_opencv(matrix, distortion, 640, 480, tolerance_px=5)
    assert camera.focal.item() == pytest.approx(502 / 480)
    with pytest.raises(UserError, match="principal point"):
        perspective_from_colmap(torch.tensor([500.0, 318, 240, 0, 0]), 640, 480)
    assert perspective_from_colmap(torch.tensor([480.0, 318, 240, 0, 0]), 640, 480, tolerance_px=2).focal == 1


def test_centres_of_integers_are_not_rounded():
    with pytest.raises(UserError, match=r"\(-0.5, -0.5\) pixels from the image centre"):
        perspective_from_opencv(near_opencv()[0].long(), torch.zeros(4), 640, 480)
    with pytest.raises(UserError, match=r"\(-0.5, -0.5\) pixels from the image centre"):
        perspective_from_colmap(torch.tensor([500, 320, 240, 0, 0]), 641, 481)


@pytest.mark.parametrize(("count", "right"), [(4, True), (8, True), (14, True), (2, False), (6, False)])
def test_opencvs_numbers_of_coefficients(count, right):
    matrix, _ = near_opencv()
    distortion = torch.zeros(count, dtype=torch.float64)
    if right:
        assert perspective_from_opencv(matrix, distortion, 640, 480).k1 == 0
    else:
        with pytest.raises(UserError, match=f"coefficients, got {count}"):
            perspective_from_opencv(matrix, distortion, 640, 480)


def test_geocalib_without_a_field_of_view_is_refused():
    values = [torch.tensor(value) for value in (0.0, 0.0, 0.0, 0.0, 0.0)]
    with pytest.raises(UserError, match="focal"):
        perspective_from_geocalib(GeoCalibCamera(*values), 640, 480)
