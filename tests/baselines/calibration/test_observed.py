"""From a field or rays to a camera: exact observations give it to rounding, spreads are what its errors are."""

import math

import numpy as np
import pytest
import torch

from sextant.baselines.calibration import ObservedField, ObservedRays, map_points
from sextant.baselines.calibration.observed import INDEPENDENT, MOST
from sextant.errors import ArgumentError
from sextant.geometry import CameraParameters, PerspectiveCamera, k2_of_k1, up_in_camera
from sextant.geometry.distortion import max_distorted_radius
from sextant.geometry.perspective_field import perspective_field


def drawn(count, seed=0):
    """Cameras of many kinds whose whole picture is before the fold, each with its aspect."""
    rng = np.random.default_rng(seed)
    while count:
        tilt, roll, focal = rng.uniform(-0.6, 0.6), rng.uniform(-0.5, 0.5), math.exp(rng.uniform(-0.9, 0.9))
        k1, aspect = rng.uniform(-0.3, 0.1), rng.choice([0.75, 1, 4 / 3, 16 / 9])
        fold = float(max_distorted_radius(*(k1 := torch.tensor(k1, dtype=torch.float64), k2_of_k1(k1))))
        if math.hypot(aspect, 1) / 2 < focal * fold:
            count -= 1
            yield tilt, roll, focal, float(k1), aspect


def rays_of(focal, k1, aspect, rows=12, columns=16):
    """Rays by the package's camera of an image of pixels, not by the equation of a field."""
    first, bend = torch.tensor([focal, k1], dtype=torch.float64)
    camera = PerspectiveCamera(first, bend, k2_of_k1(bend), round(900 * aspect), 900)
    points = map_points(rows, columns, aspect)
    pixels = torch.from_numpy(points * 900 + [450 * aspect, 450])
    return points, camera.bearings(pixels).double().numpy(), camera


def field_of(tilt, roll, focal, k1, aspect):
    """Latitudes and up directions by moving points of the scene, in single steps along gravity."""
    points, rays, camera = rays_of(focal, k1, aspect)
    up = up_in_camera(*torch.tensor([tilt, roll], dtype=torch.float64)).numpy()
    step = 1e-6
    seen = [camera.project(torch.from_numpy(rays + sign * step * up))[0].numpy() for sign in (1, -1)]
    return points, np.arcsin(rays @ up), seen[0] - seen[1]


def numbers(belief):
    return belief.tilt, belief.roll, belief.focal, belief.k1_hat * belief.focal**2


@pytest.mark.parametrize("camera", [*drawn(8)])
def test_an_exact_field_gives_its_camera(camera):
    points, latitude, up = field_of(*camera)
    sigma = np.full(len(points), 0.02)
    belief = ObservedField(points, latitude, up, sigma, sigma).belief()
    assert numbers(belief) == pytest.approx(camera[:4], abs=1e-6)  # of the difference by which up is found


@pytest.mark.parametrize("camera", [*drawn(8, seed=1)])
def test_exact_rays_give_their_lens_and_no_pose(camera):
    points, rays, _ = rays_of(*camera[2:])
    belief = ObservedRays(points, 3 * rays).belief()
    assert numbers(belief)[2:] == pytest.approx(camera[2:4], abs=1e-9)
    assert belief.sigma[:2] == (math.inf, math.inf)
    assert max(belief.sigma[2:]) < 1e-3  # no scatter, no doubt


@pytest.mark.slow
def test_errors_are_as_large_as_told():
    """With as many independent points as a field is worth, the standard errors are the spread of the estimates."""
    camera, rng = (0.15, -0.05, 0.8, -0.05), np.random.default_rng(0)
    points = map_points(2, 4, 4 / 3)[:7]
    assert len(points) < INDEPENDENT
    truth = CameraParameters(*torch.tensor(camera, dtype=torch.float64))
    field, spread = perspective_field(truth, torch.from_numpy(points)), np.full(7, 0.01)
    found = []
    for _ in range(25):
        angle = np.arctan2(*field.up.numpy().T[::-1]) + rng.normal(0, 0.01, 7)
        latitude = field.latitude.numpy() + rng.normal(0, 0.01, 7)
        belief = ObservedField(
            points, latitude, np.column_stack([np.cos(angle), np.sin(angle)]), spread, spread
        ).belief()
        vfov = 2 * math.atan(0.5 / belief.focal)
        off = np.array([belief.tilt - 0.15, belief.roll + 0.05, vfov - 2 * math.atan(0.5 / 0.8)])
        found.append(off / np.array(belief.sigma[:3]))
    assert np.sqrt(np.mean(np.square(found), axis=0)) == pytest.approx(1, abs=0.45)


def test_spreads_are_honoured():
    """Points that are told to be uncertain do not move the camera, and twice the spread is twice the error."""
    camera = (0.15, -0.05, 0.8, -0.05, 4 / 3)
    points, latitude, up = field_of(*camera)
    wrong = points[:, 0] > 0.2
    latitude = np.where(wrong, latitude + 0.3, latitude)
    sure, told = np.full(len(points), 0.02), np.where(wrong, 5.0, 0.02)
    good = ObservedField(points, latitude, up, told, told).belief()
    bad = ObservedField(points, latitude, up, sure, sure).belief()
    assert abs(good.tilt - 0.15) < 2e-3 < abs(bad.tilt - 0.15)
    assert bad.sigma[0] > 2 * good.sigma[0]  # a field that contradicts itself is believed less
    points, latitude, up = field_of(*camera)
    once, twice = (ObservedField(points, latitude, up, s, s).belief().sigma for s in (sure, 2 * sure))
    assert np.array(twice) / np.array(once) == pytest.approx(2, rel=1e-3)


def test_the_scatter_of_rays_is_their_spread():
    points, rays, _ = rays_of(0.8, -0.05, 4 / 3)
    rng = np.random.default_rng(0)
    sigmas = [ObservedRays(points, rays + rng.normal(0, s, rays.shape)).belief().sigma[2] for s in (0.002, 0.004)]
    assert sigmas[1] / sigmas[0] == pytest.approx(2, rel=0.3)


def test_without_distortion_it_is_0_and_not_known():
    points, latitude, up = field_of(0.15, -0.05, 0.8, 0.0, 4 / 3)
    sure = np.full(len(points), 0.02)
    both = [ObservedField(points, latitude, up, sure, sure, distortion=kept).belief() for kept in (False, True)]
    assert numbers(both[0]) == pytest.approx((0.15, -0.05, 0.8, 0.0), abs=1e-6)
    assert (both[0].k1_hat, both[0].sigma[3]) == (0.0, math.inf)
    assert both[0].sigma[2] < both[1].sigma[2]  # one number less to find
    rays = ObservedRays(*rays_of(0.8, 0.0, 4 / 3)[:2], distortion=False).belief()
    assert (rays.focal, rays.k1_hat) == (pytest.approx(0.8), 0.0)


def test_a_measured_scatter_is_that_of_a_given_spread():
    """A ray has two numbers, so that its scatter is not divided by the three of a vector."""
    points, rays, _ = rays_of(0.8, -0.05, 4 / 3, 24, 32)
    noisy = rays + np.random.default_rng(0).normal(0, 0.002, rays.shape)
    measured, given = (ObservedRays(points, noisy, sigma).belief() for sigma in (None, np.full(len(points), 0.02)))
    assert np.array(measured.sigma[2:]) / given.sigma[2:] == pytest.approx(0.002 / 0.02, rel=0.04)


@pytest.mark.parametrize("size", [(512, 512), (1024, 1024)])
def test_the_points_that_are_used_cover_a_large_map(size):
    points = map_points(*size, 1.0)
    used = ObservedRays(points, np.column_stack([points, np.ones(len(points))])).points
    assert len(used) == MOST
    assert abs(np.corrcoef(used.T)[0, 1]) < 0.1
    assert np.histogram2d(*used.T, bins=4)[0].min() > 30  # 64 on average


@pytest.mark.parametrize("points", [np.zeros((6, 2)), np.full((6, 2), 0.1)])
def test_points_that_determine_nothing_are_told(points):
    with pytest.raises(ArithmeticError, match="does not determine a camera"):
        ObservedRays(points, np.column_stack([points, np.ones(6)])).belief()


def test_a_number_at_an_end_of_the_search_is_not_known():
    points = map_points(6, 8, 4 / 3)
    straight = np.tile([0.0, 0.0, 1.0], (len(points), 1))  # all rays parallel: an endless focal length
    assert ObservedRays(points, straight).belief().sigma[2] == math.inf


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"latitude": np.zeros(3)}, r"ObservedField: latitude has the shape \(3,\), and \(48,\) is expected"),
        ({"points": np.zeros((3, 2))}, "ObservedField: 3 points; at least 4 are needed"),
        ({"points": None}, "ObservedField: 0 points"),
        ({"up": np.zeros((48, 2))}, "up directions must not be 0"),
        ({"up_sigma": np.zeros(48)}, "up_sigma must be finite and above 0"),
        ({"latitude": np.full(48, np.nan)}, "latitude must be finite"),
    ],
)
def test_wrong_arrays_are_named(change, says):
    good = {
        "points": map_points(6, 8, 4 / 3), "latitude": np.zeros(48), "up": np.tile([0.0, -1.0], (48, 1)),
        "latitude_sigma": np.ones(48), "up_sigma": np.ones(48),
    }  # fmt: skip
    with pytest.raises(ArgumentError, match=says):
        ObservedField(**good | change)
