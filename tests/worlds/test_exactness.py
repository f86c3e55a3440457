"""What is rendered is where the equations of the camera say, to a fraction of a pixel and to a millionth of a depth."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds.handmade import OVERCAST, box, floor, pose, rectangle, renderer, small_town, town_renderer, undeveloped

from sextant.data.worlds.shots import camera_poses
from sextant.geometry import (
    EquirectangularCamera,
    PerspectiveCamera,
    horizon_foot,
    horizon_line,
    k2_of_k1,
    level_camera_pose,
    rho_from_tilt,
    tau_from_tilt,
)
from sextant.worlds.appearance import Appearance, condition
from sextant.worlds.laser import LaserScanner, scan
from sextant.worlds.renderer import Rays
from sextant.worlds.scene import MISS

PLAIN_LOOK = Appearance(cloud_cover=1.0, gamma=1.0)
#: a floor so wide that its rim is 2e-7 rad below the horizon
WIDE = 2.0**23


def f64(value):
    return torch.tensor(value, dtype=torch.float64)


def lens(width, height, vfov_deg, k1=0.0):
    return PerspectiveCamera.from_vfov(f64(math.radians(vfov_deg)), width, height, k1=f64(k1))


def rays_through(camera, points):
    """Rays through a table of pixels, one sample each."""
    return Rays.of(camera.bearings(torch.from_numpy(points)).numpy()[:, :, None])


def line_residual(points):
    """Largest distance of points to the line that fits them best."""
    centred = points - points.mean(0)
    return np.abs(centred @ np.linalg.svd(centred)[2][1]).max()


def edge_columns(picture, white, black):
    """Column of the edge in each row, from how much of it is white rather than black."""
    light, high, low = (undeveloped(p)[..., 1] for p in (picture, white, black))
    return light.shape[1] - ((light - low) / (high - low)).sum(1)


# -- straight lines ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("k1", "roll"), [(-0.3, 0.0), (-0.3, 0.12), (0.15, -0.08)])
def test_a_straight_edge_is_straight_once_undistorted_and_only_then(k1, roll):
    camera = lens(120, 90, 75, k1)
    # a white wall that fills the right of the view, its upright end 3.4 m to the left; behind it nothing but black
    wall, whole = (box((6.25, y - 20, -40.0), (0.5, 40.0, 80.0), colour=(0.9, 0.9, 0.9)) for y in (3.4, 15.0))
    black = box((60.0, 0.0, -300.0), (1.0, 900.0, 600.0), colour=(0.0, 0.0, 0.0))
    eye, rays = pose(0, 0, 0, 0, 0, roll), Rays.of(camera.bearings(camera.ray_grid(10)).numpy())
    pictures = [renderer(*parts).picture(rays, eye, PLAIN_LOOK) for parts in ((wall, black), (whole, black), (black,))]
    column = edge_columns(*pictures)
    row = np.arange(camera.height) + 0.5
    assert 5 < column.min() < column.max() < 57
    seen = np.column_stack([column, row])
    rays = camera.bearings(torch.from_numpy(seen)).numpy()
    straight = float(camera.focal) * camera.height * rays[:, :2] / rays[:, 2:]
    assert line_residual(straight) < 0.1
    assert line_residual(seen) > 1.0  # the lens does bend it: the test can fail
    wrong = lens(120, 90, 75, 0.7 * k1).bearings(torch.from_numpy(seen)).numpy()
    assert line_residual(float(camera.focal) * camera.height * wrong[:, :2] / wrong[:, 2:]) > 0.15


def test_a_corner_is_seen_where_the_camera_projects_it():
    camera = lens(120, 90, 60, -0.2)
    corner = np.array([7.0, 1.5, 2.25])
    drawer = renderer(box((9.0, 1.5 - 8, -5.0), (4.0, 16.0, 7.25), colour=(1, 1, 1)))
    eye = camera_poses(np.array([[0.3, 0.2, 1.6, 0.05, 0.1, -0.06]]))[0]
    ahead = (corner - eye[:3, 3]) @ eye[:3, :3]
    at, visible = camera.project(torch.from_numpy(ahead)[None])
    assert visible.all()
    assert camera.contains(at).all()
    fine = (np.arange(-40, 40) + 0.5) / 20
    grid = at[0].numpy() + np.stack(np.meshgrid(fine, fine), -1)
    solid = drawer.view(rays_through(camera, grid), eye, OVERCAST).surface != MISS
    # the box ends above and to the left of its corner: its lower right quarter is seen
    assert solid[-1, -1]
    assert not solid[0, -1]
    assert not solid[-1, 0]
    step = fine[1] - fine[0]
    mid = len(fine) // 2
    assert np.flatnonzero(solid[:, mid + 4])[0] * step + fine[0] == pytest.approx(0, abs=0.1)
    assert np.flatnonzero(solid[mid + 4])[0] * step + fine[0] == pytest.approx(0, abs=0.1)


# -- the horizon -------------------------------------------------------------------------------------------------------

SEA = renderer(floor(WIDE))


@settings(max_examples=12)
@given(st.floats(-0.25, 0.25), st.floats(-0.6, 0.6), st.floats(50, 80), st.floats(-0.35, 0.1))
def test_the_foot_of_the_horizon_is_rho_from_the_centre_to_a_hundredth_of_a_pixel(tilt, roll, vfov, k1):
    camera = lens(320, 240, vfov, k1)
    k1, k2 = camera.k1, camera.k2
    rho = float(rho_from_tilt(f64(tilt), camera.focal, k1, k2_of_k1(k1)))
    assert k2 == k2_of_k1(k1)
    foot = horizon_foot(f64(rho), f64(roll)).numpy()
    away = np.array([math.sin(roll), math.cos(roll)])
    centre = np.array([160.0, 120.0])
    steps = np.arange(-200, 201) / 100 + 0.003  # pixels across the foot
    across = centre + foot * 240 + steps[:, None] * away
    eye = camera_poses(np.array([[0.0, 0.0, 1.6, 0.7, tilt, roll]]))[0]
    ground = SEA.view(rays_through(camera, across[None]), eye, OVERCAST).surface[0] != MISS
    assert (np.diff(ground.astype(int)) >= 0).all()  # sky, then ground
    edge = steps[np.argmax(ground)]
    assert 0 <= edge < 0.02


@pytest.mark.parametrize("tilt", [-0.3, 0.0, 0.22])
@pytest.mark.parametrize("roll", [-0.5, 0.1])
@pytest.mark.parametrize("k1", [0.0, -0.3])
def test_every_pixel_is_on_its_side_of_the_horizon(tilt, roll, k1):
    camera = lens(96, 72, 65, k1)
    eye = camera_poses(np.array([[10.0, -4.0, 1.6, 2.0, tilt, roll]]))[0]
    rays = Rays.of_camera(camera, 1)
    view = SEA.view(rays, eye, OVERCAST)
    # without distortion the horizon is the line a u + b v + c = 0
    ideal = float(camera.focal) * rays.bearings[:, :2] / rays.bearings[:, 2:]
    a, b, c = horizon_line(tau_from_tilt(f64(tilt), camera.focal), f64(roll)).tolist()
    below = (a * ideal[:, 0] + b * ideal[:, 1] + c).reshape(72, 96) * 72  # pixels
    sure = np.abs(below) > 0.01
    assert np.array_equal((view.surface != MISS)[sure], (below > 0)[sure])
    assert np.array_equal(np.isfinite(view.distance_m), view.surface != MISS)
    assert 0.1 < (view.surface != MISS).mean() < 0.95
    rho = float(rho_from_tilt(f64(tilt), camera.focal, camera.k1, camera.k2))
    rows, columns = np.nonzero(np.diff((view.surface != MISS).astype(int), axis=0))
    borders = np.column_stack([columns + 0.5 - 48, rows + 1.0 - 36]) / 72
    assert np.linalg.norm(borders, axis=1).min() * 72 == pytest.approx(abs(rho) * 72, abs=0.75)


# -- depth -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("away", [0.0, 3000.0])
@pytest.mark.parametrize("k1", [0.0, -0.25])
def test_depth_is_that_of_planes_in_closed_form(away, k1):
    camera = lens(64, 48, 65, k1)
    eye = camera_poses(np.array([[away + 0.123, -17.771 - away, 1.61, 0.7, -0.1, 0.2]]))[0]
    rays = Rays.of_camera(camera, 1)
    ways, place = rays.bearings @ eye[:3, :3].T, eye[:3, 3]
    view = renderer(floor(8192.0)).view(rays, eye, OVERCAST)
    hit = np.isfinite(view.distance_m.ravel())
    assert 0.3 < hit.mean() < 0.95
    near = hit & (view.distance_m.ravel() < 2000)
    expected = -place[2] / ways[near, 2]
    assert np.abs(view.distance_m.ravel()[near] / expected - 1).max() < 1e-9
    corners = np.array([(away + 1.0, -5.0 - away), (away + 14.0, -24.5 - away)], np.float32).astype(float)
    (x0, y0), (x1, y1) = corners
    view = renderer(rectangle((x0, y0, -6), (x1, y1, -6), (x1, y1, 9), (x0, y0, 9))).view(rays, eye, OVERCAST)
    hit = np.isfinite(view.distance_m.ravel())
    assert hit.mean() > 0.2
    normal = np.array([y1 - y0, x0 - x1, 0.0])
    expected = ((x0 - place[0]) * normal[0] + (y0 - place[1]) * normal[1]) / (ways[hit] @ normal)
    assert np.abs(view.distance_m.ravel()[hit] / expected - 1).max() < 1e-9


def test_distance_is_of_the_first_sample_of_a_pixel():
    camera, drawer = lens(16, 12, 60), renderer(floor())
    eye = camera_poses(np.array([[0.0, 0, 1.6, 0, -0.4, 0]]))[0]
    rays = Rays.of_camera(camera, 4)
    view = drawer.view(rays, eye, OVERCAST)
    first = rays.bearings[::4] @ eye[:3, :3].T
    sure = first[:, 2] < -0.01
    assert view.distance_m.ravel()[sure] == pytest.approx(-1.6 / first[sure, 2], rel=1e-9)


# -- one world for all cameras and the laser ---------------------------------------------------------------------------


def test_a_panorama_and_a_picture_agree_along_the_same_rays():
    drawer = town_renderer(Appearance())
    camera, panorama = lens(96, 72, 70, -0.25), EquirectangularCamera(256, 128)
    graph = small_town().graph
    middle = graph.nodes[graph.edges[0]].mean(0)
    eye = camera_poses(np.array([[*middle, 1.6, 0.4, 0.05, 0.1]]))[0]
    all_rays = Rays.of_camera(panorama, 1)
    whole = drawer.view(all_rays, eye, OVERCAST)
    at, visible = camera.project(panorama.bearings(panorama.pixel_centres(dtype=torch.float64)))
    seen = (visible & camera.contains(at)).numpy()
    assert seen.mean() > 0.05
    rays = rays_through(camera, at.numpy()[seen][None])
    part = drawer.view(replace(rays, pixel=all_rays.pixel), eye, OVERCAST)  # gaps in foliage are as fine as pixels
    there, here = whole.distance_m[seen], part.distance_m[0]
    same = whole.surface[seen] == part.surface[0]
    assert same.mean() > 0.999  # but where a ray falls on an edge
    assert np.array_equal(np.isfinite(there[same]), np.isfinite(here[same]))
    both = same & np.isfinite(there) & np.isfinite(here)
    assert np.mean(np.abs(there[both] / here[both] - 1) < 1e-9) > 0.995
    assert np.median(np.abs(whole.radiance[seen] - part.radiance[0])) < 0.01


def test_laser_ranges_are_the_depth_that_a_camera_sees_in_their_plane():
    drawer = town_renderer(Appearance())
    graph = small_town().graph
    (x, y), heading = graph.nodes[graph.edges[1]].mean(0), 0.9
    camera = PerspectiveCamera.from_vfov(f64(1.0), 121, 81, k1=f64(-0.2))
    middle = camera.pixel_centres()[40:41].numpy()
    bearings = camera.bearings(torch.from_numpy(middle)).numpy()[0]
    assert np.abs(bearings[:, 1]).max() == 0
    for height in (0.35, 1.5):
        eye = level_camera_pose(f64(x), f64(y), f64(height), f64(heading)).numpy()
        seen = drawer.view(rays_through(camera, middle), eye, OVERCAST).distance_m[0]
        angles = -np.arctan2(bearings[:, 0], bearings[:, 2])  # counter-clockwise is to the left
        scanner = LaserScanner(beams=1, max_range_m=1e4, height_m=height, range_sigma_m=0.5, dropout=0.5).exact()
        poses = np.column_stack([np.full(121, x), np.full(121, y), heading + angles])
        ranges = scan(scanner, drawer.scene, poses, np.random.default_rng(0))[:, 0]
        ranges = np.where(ranges == 1e4, np.inf, ranges)
        solid = np.isfinite(seen) & np.isfinite(ranges)
        assert solid.mean() > 0.9
        assert (
            np.mean(np.abs(seen[solid] / ranges[solid] - 1) < 1e-6) > 0.97
        )  # leaves let some rays of a camera through


def test_wet_or_dark_the_geometry_is_the_same():
    drawer = town_renderer(Appearance())
    graph = small_town().graph
    eye = camera_poses(np.array([[*graph.nodes[graph.edges[2]].mean(0), 1.6, 0.4, 0.0, 0.0]]))[0]
    rays = Rays.of_camera(lens(48, 32, 60), 1)
    day, night = (drawer.view(rays, eye, look) for look in (Appearance(), condition("night_rain")))
    assert np.array_equal(day.distance_m, night.distance_m)
    assert np.array_equal(day.surface, night.surface)
    assert not np.allclose(day.radiance, night.radiance)
