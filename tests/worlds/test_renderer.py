"""A picture is a function of world, camera, appearance and seed alone: not of threads, batches or processes."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from worlds.handmade import (
    OVERCAST,
    box,
    down,
    floor,
    pinhole,
    pose,
    renderer,
    small_town,
    town_poses,
    town_renderer,
    town_sha256,
)  # fmt: skip

from sextant.errors import UserError
from sextant.worlds import renderer as renderer_module
from sextant.worlds.appearance import Appearance, condition
from sextant.worlds.lamps import Lamps
from sextant.worlds.renderer import Motion, Rays, Renderer, gamma_curve
from sextant.worlds.scene import MISS
from sextant.worlds.town import Town

RAYS = pinhole(40, 30, 70, 4)
NOISY = Appearance(read_noise=0.02, shot_noise=0.05)
TESTS = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_same_bytes_on_one_core_and_on_two_threads():
    code = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); from worlds.handmade import *; "
    environment = os.environ | {"PYTHONPATH": str(TESTS), "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    here = town_sha256(2)  # first: it leaves the compiled code behind
    assert town_sha256(1) == here
    command = [sys.executable, "-c", code + "print(town_sha256(1))"]
    alone = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, timeout=280, check=True)
    assert alone.stdout.split() == [here]


@pytest.mark.slow
@pytest.mark.parametrize("soft", [False, True])
def test_a_picture_is_the_same_alone_and_in_a_batch(soft, monkeypatch):
    look = condition("autumn_rain", read_noise=0.01, exposure_time_s=0.05)
    town, poses = town_renderer(look), town_poses(5)
    drawer = Renderer(town.scene, town.lamps, soft=soft)
    motions = np.linspace(-3, 3, 20).reshape(5, 4) * [1, 1, 0.1, 0.1]
    seeds = np.arange(5) + 7
    together = drawer.pictures(RAYS, poses, look, motions=motions, seeds=seeds)
    for i in (0, 3):
        motion = Motion(tuple(motions[i, :3]), float(motions[i, 3]))
        alone = drawer.picture(RAYS, poses[i], look, motion=motion, seed=int(seeds[i]))
        assert np.array_equal(alone, together[i])
    assert np.array_equal(
        drawer.pictures(RAYS, poses[::-1], look, motions=motions[::-1], seeds=seeds[::-1])[::-1], together
    )
    monkeypatch.setattr(renderer_module, "CHUNK", 2 * len(RAYS.bearings))  # two pictures at a time
    assert np.array_equal(drawer.pictures(RAYS, poses, look, motions=motions, seeds=seeds), together)


@pytest.mark.slow
def test_a_large_picture_is_shaded_in_parts_without_seams(monkeypatch):
    look = condition("autumn_rain", exposure_time_s=0.1)
    drawer, motion = town_renderer(look), Motion((4.0, 1.0, 0.0), 0.3)
    whole = drawer.view(RAYS, town_poses()[0], look, motion=motion)
    monkeypatch.setattr(renderer_module, "CHUNK", 1001)  # no multiple of the samples, nor a divisor of the picture
    parts = drawer.view(RAYS, town_poses()[0], look, motion=motion)
    assert np.array_equal(whole.radiance, parts.radiance)
    assert np.array_equal(whole.distance_m, parts.distance_m)
    assert np.array_equal(whole.surface, parts.surface)


def test_worlds_of_one_seed_are_one_world_and_of_two_seeds_two():
    graph, look = small_town().graph, Appearance(traffic_per_100m=2)
    meshes = [Town(graph, seed, detail="coarse").mesh(look) for seed in (3, 3, 4)]
    assert np.array_equal(meshes[0].triangles, meshes[1].triangles)
    assert np.array_equal(meshes[0].surfaces, meshes[1].surfaces)
    assert meshes[0].triangles.shape != meshes[2].triangles.shape


def test_sensor_noise_is_a_function_of_its_seed():
    drawer = town_renderer(NOISY)
    a, b, c = (drawer.picture(RAYS, town_poses()[1], NOISY, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(a, b)
    assert (a != c).mean() > 0.5


def test_a_view_tells_what_each_pixel_shows():
    ground, house = floor(50, colour=(0.1, 0.2, 0.3)), box((8, 0, 0), (2, 2, 4), colour=(0.5, 0, 0))
    drawer = renderer(ground, house)
    view = drawer.view(pinhole(41, 31, 60), pose(0, 0, 1.6), OVERCAST)
    rows = {"ground": 0, "house": 1, "sky": MISS}
    assert view.surface[15, 20] == rows["house"]
    assert view.distance_m[15, 20] == pytest.approx(7.0, rel=1e-6)
    assert view.surface[30, 2] == rows["ground"]
    assert view.surface[0, 2] == rows["sky"]
    assert np.isinf(view.distance_m[0, 2])
    assert view.radiance.dtype == np.float32
    assert view.radiance[15, 20, 0] > 3 * view.radiance[15, 20, 2]
    assert view.radiance[0, 2, 2] > 0.1


def test_rays_know_their_spacing():
    rays = pinhole(200, 100, 40, 4)
    assert (rays.width, rays.height, rays.samples, len(rays.bearings)) == (200, 100, 4, 80_000)
    assert rays.pixel == pytest.approx(np.radians(40) / 200, rel=0.05)
    assert Rays.of(np.ones((3, 1, 1, 3)) / np.sqrt(3)).pixel == 1.0


def test_a_pose_inside_a_wall_or_without_numbers_is_refused():
    drawer = renderer(floor(50), box((8, 0, 0), (2, 2, 4)))
    good, bad = pose(0, 0, 1.6), pose(8.1, 0.2, 1.6)
    with pytest.raises(UserError, match=r"camera pose 2 at \(8\.10, 0\.20, 1\.60\) lies inside a wall \(and 1 more\)"):
        drawer.pictures(RAYS, np.stack([good, good, bad, bad]), OVERCAST)
    with pytest.raises(UserError, match=r"camera pose 0 .* lies inside a wall"):
        drawer.view(RAYS, bad, OVERCAST)
    bad[0, 3] = np.nan
    with pytest.raises(UserError, match=r"camera pose 1 .* is not finite"):
        drawer.pictures(RAYS, np.stack([good, bad]), OVERCAST)


def test_a_pose_is_named_by_its_number_however_many_are_rendered_at_a_time(monkeypatch):
    monkeypatch.setattr(renderer_module, "CHUNK", 1)
    drawer = renderer(floor(50), box((8, 0, 0), (2, 2, 4)))
    with pytest.raises(UserError, match="camera pose 3 "):
        drawer.pictures(RAYS, np.stack([pose(0, 0, 1)] * 3 + [pose(8, 0, 1)]), OVERCAST)


@pytest.mark.parametrize("gamma", [0.5, 1.0, 2.2, 4.0])
def test_the_tone_curve_is_monotone_and_a_power(gamma):
    curve = gamma_curve(gamma).astype(int)
    assert (curve[0], curve[-1]) == (0, 255)
    assert (np.diff(curve) >= 0).all()
    level = np.arange(65536) / 65535
    assert np.abs(curve - 255 * level ** (1 / gamma)).max() <= 0.5 + 1e-9


# -- motion ------------------------------------------------------------------------------------------------------------


def blur_width(rays, motion, exposure_s, heading=0.0):
    """Columns that are neither the black nor the white side of an upright edge ahead."""
    white = box((10, -50, -20), (0.5, 100, 40), colour=(0.9, 0.9, 0.9))
    black = box((40, 0, -200), (0.5, 400, 400), colour=(0, 0, 0))
    look = Appearance(cloud_cover=1.0, exposure_time_s=exposure_s)
    row = renderer(white, black).view(rays, pose(0, 0, 0, heading), look, motion=motion).radiance.mean(0)[:, 1]
    return np.sum((row > 0.15 * row.max()) & (row < 0.8 * np.median(row[-10:])))


def test_a_moving_camera_blurs_an_edge_by_its_way_and_no_other():
    rays = pinhole(80, 24, 40, 16)  # half a degree a pixel: 0.087 m at 10 m
    sideways, ahead = Motion((0.0, 10.0, 0.0)), Motion((10.0, 0.0, 0.0))
    assert blur_width(rays, sideways, 0.0) <= 1
    assert blur_width(rays, Motion(), 0.2) <= 1
    assert blur_width(rays, ahead, 0.05) <= 2
    width = 10 * 0.1 / (10 * np.radians(40) / 80)
    assert blur_width(rays, sideways, 0.1) == pytest.approx(0.65 * width, rel=0.25)
    assert blur_width(rays, Motion((0.0, -10.0, 0.0)), 0.1) == pytest.approx(0.65 * width, rel=0.25)
    assert blur_width(rays, Motion(turn_rate=0.1 / 0.1), 0.1) == pytest.approx(0.65 * width, rel=0.25)


def test_a_closed_shutter_leaves_every_byte():
    drawer, still = town_renderer(Appearance()), Appearance()
    moving = Motion((9.0, 9.0, 0.0), 1.0)
    first = drawer.picture(RAYS, town_poses()[0], still)
    assert np.array_equal(first, drawer.picture(RAYS, town_poses()[0], still, motion=moving))
    blurred = Appearance(exposure_time_s=0.05)
    assert not np.array_equal(first, drawer.picture(RAYS, town_poses()[0], blurred, motion=moving))
    assert np.array_equal(first, drawer.picture(RAYS, town_poses()[0], blurred))


# -- light -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("azimuth", [0.0, 130.0, 250.0])
@pytest.mark.parametrize("elevation", [25.0, 50.0])
def test_a_shadow_falls_where_the_sun_says(azimuth, elevation):
    look = Appearance(sun_elevation_deg=elevation, sun_azimuth_deg=azimuth, cloud_cover=0.0)
    drawer = renderer(floor(60, colour=(0.5, 0.5, 0.5)), box((0, 0, 0), (0.4, 0.4, 5), colour=(0.5, 0.5, 0.5)))
    view = drawer.view(pinhole(201, 201, 60), down(0, 0, 40), look)
    metres = 2 * 40 * np.tan(np.radians(30)) / 201
    dark = (view.radiance[..., 0] < 0.6 * np.median(view.radiance[..., 0])) & (view.surface == 0)
    rows, columns = np.nonzero(dark)
    x, y = (columns - 100) * metres, (100 - rows) * metres
    tip = np.argmax(np.hypot(x, y))
    away = np.radians(azimuth + 180)
    length = 5 / np.tan(np.radians(elevation))
    assert np.hypot(x[tip], y[tip]) == pytest.approx(length, abs=2.5 * metres)
    assert x[tip] == pytest.approx(length * np.cos(away), abs=3 * metres)
    assert y[tip] == pytest.approx(length * np.sin(away), abs=3 * metres)
    covered = renderer(floor(60), box((0, 0, 0), (0.4, 0.4, 5))).view(
        pinhole(201, 201, 60), down(0, 0, 40), Appearance(sun_elevation_deg=elevation, cloud_cover=1.0)
    )
    ground = covered.radiance[..., 0][covered.surface == 0]
    assert ground.min() > 0.85 * np.median(ground)  # no sun, no shadow


def test_soft_light_darkens_a_corner_between_walls():
    yard = [
        floor(40, colour=(0.5,) * 3),
        box((0, 6, 0), (16, 1, 12), colour=(0.5,) * 3),
        box((8, 0, 0), (1, 12, 12), colour=(0.5,) * 3),
    ]
    rays = pinhole(31, 31, 40, 64)
    hard, soft = (
        renderer(*yard, soft=s).view(rays, down(3.5, 1.5, 11), OVERCAST).radiance[..., 1] for s in (False, True)
    )
    corner, open_ground = (slice(2, 6), slice(24, 28)), (slice(24, 30), slice(1, 6))
    assert soft[corner].mean() < 0.8 * soft[open_ground].mean()
    assert hard[corner].mean() > 0.85 * hard[open_ground].mean()


def test_wet_ground_mirrors_a_wall():
    wall = box((30, 0, 0), (1, 60, 12), colour=(1.0, 0.0, 0.0))
    rays, eye = pinhole(60, 40, 50), pose(0, 0, 1.6, 0, -0.1)
    red = {}
    for wet in (0.0, 1.0):
        view = renderer(floor(80, colour=(0.1,) * 3), wall).view(rays, eye, Appearance(wetness=wet, cloud_cover=1.0))
        without = renderer(floor(80, colour=(0.1,) * 3)).view(rays, eye, Appearance(wetness=wet, cloud_cover=1.0))
        near = (view.surface == 0) & (view.distance_m > 12)
        red[wet] = (view.radiance[near] / without.radiance[near]).mean(0)
    assert red[0.0] == pytest.approx([1, 1, 1], abs=1e-5)
    assert red[1.0][0] > 1.3 * red[1.0][1]  # the wall's red instead of the sky's blue


def test_lamps_light_the_ground_below_them_at_night_only():
    lamps = Lamps.at(np.array([[0.0, 0.0, 5.6]]))
    drawer = renderer(floor(60, colour=(0.3,) * 3), lamps=lamps)
    rays, eye = pinhole(61, 61, 80), down(0, 0, 20)
    night, dark, day = (
        drawer.view(rays, eye, Appearance(sun_elevation_deg=-30, night=n)).radiance for n in (1.0, 0.0, 0.0)
    )
    assert night[30, 30].min() > 3 * night[30, 2].max()
    assert night[30, 30, 0] > 1.5 * night[30, 30, 2]  # warm
    assert np.abs(dark - day).max() == 0
    assert dark[30, 30].max() < 0.1 * night[30, 30].max()
    profile = night[30, 30:, 0]
    assert (np.diff(profile[:22:3]) < 0).all()
