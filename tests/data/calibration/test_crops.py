"""Crops against the exact geometry, against renders and many rays."""

import math

import numpy as np
import pytest
import torch
from worlds.handmade import OVERCAST, town_renderer

from sextant.chapters.calibration.data import CameraDistribution, CameraDraw, Panoramas
from sextant.chapters.calibration.data.batches import Crops
from sextant.chapters.calibration.data.crops import Sampling, crop_batch, crop_panoramas
from sextant.chapters.calibration.data.rays import Rays, newton_steps
from sextant.geometry import (
    CameraParameters,
    EquirectangularCamera,
    PerspectiveCamera,
    k2_of_k1,
    level_camera_pose,
    max_distorted_radius,
    rotation_from_tilt_roll,
)
from sextant.geometry.canvas import picture_size
from sextant.worlds.renderer import Rays as WorldRays

LENSES = CameraDistribution(
    tilt={"kind": "uniform", "low": -80, "high": 80},
    roll={"kind": "uniform", "low": -180, "high": 180},
    focal={"kind": "uniform", "low": 0.45, "high": 2.0},
    k1={"kind": "uniform", "low": -0.4, "high": 0.1},
    aspect={"1:1": 1, "4:3": 1, "16:9": 1},
    tilt_as="tilt_deg",
    roll_as="roll_deg",
    focal_as="heights",
    portrait=0.3,
)


def camera(tilt=0.0, roll=0.0, focal=0.8, k1=-0.2, n=1):
    return CameraParameters(*(torch.full((n,), float(value), dtype=torch.float64) for value in (tilt, roll, focal, k1)))


def angles(*values):
    return torch.tensor(values, dtype=torch.float64)


def turned_right(yaw):
    """The turn about the vertical, written out apart from the code under test: forward goes to the right."""
    c, s = math.cos(yaw), math.sin(yaw)
    return torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)


def exact_directions(draw, i, width, height, family="lopez"):
    """Directions in the panorama's frame of the rays of camera ``i``, in float64 by the geometry's own camera."""
    tilt, roll, focal, k1 = (value[i] for value in draw.cameras)
    aspect = draw.aspect[i].item()
    u = ((torch.arange(width, dtype=torch.float64) + 0.5) / width - 0.5) * aspect
    v = (torch.arange(height, dtype=torch.float64) + 0.5) / height - 0.5
    lens = PerspectiveCamera(focal, k1, k2_of_k1(k1, family), round(1e6 * aspect), 10**6)  # pixels of a millionth
    points = torch.stack(torch.meshgrid(u, v, indexing="xy"), -1) * 1e6
    points = points + torch.tensor([lens.width / 2, lens.height / 2], dtype=torch.float64)
    bearings = lens.bearings(points.reshape(-1, 2)).reshape(height, width, 3)
    return bearings @ (turned_right(draw.yaw[i].item()) @ rotation_from_tilt_roll(tilt, roll)).mT


def smooth_colour(directions):
    """A picture of all directions that has no detail: any right sampling sees it exactly."""
    x, y, z = directions.unbind(-1)
    return torch.stack([128 + 90 * x + 30 * y * z, 128 + 100 * y - 20 * x * x, 120 + 80 * z + 40 * x * y], -1)


def painted(colour, height):
    """A panorama of a function of direction."""
    rays = EquirectangularCamera(2 * height, height)
    return colour(rays.bearings(rays.ray_grid(1, dtype=torch.float64))[..., 0, :]).round().clamp(0, 255).byte().numpy()


# -- where rays meet the panorama --------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", ["lopez", "zero"])
def test_points_are_right_to_a_hundredth_of_a_pixel_of_a_large_panorama(family):
    n, width, height, rows = 60, 61, 47, 4096
    draw = LENSES.draw(n, 5)
    if family == "zero":  # up to the very fold
        reach = torch.hypot(draw.aspect, torch.ones(())) / 2 / draw.cameras.focal
        k1 = -4 / (27 * (reach / 0.9999) ** 2)
        draw = CameraDraw(draw.cameras._replace(k1=k1), draw.yaw, draw.aspect)
        assert (reach < max_distorted_radius(k1, torch.zeros_like(k1))).all()
    rays = Rays.of(draw, family)
    worst = 0.0
    for i in range(n):
        x, y = rays.points(i, 2 * rows, rows, width, height)
        expected, _ = EquirectangularCamera(2 * rows, rows).project(exact_directions(draw, i, width, height, family))
        off_x = (x - 0.5 - expected[..., 0].numpy() + rows) % (2 * rows) - rows  # around the seam
        off_y = y - 0.5 - expected[..., 1].numpy()
        along = np.sin(np.pi * expected[..., 1].numpy() / rows)  # columns shrink toward the poles
        worst = max(worst, np.abs(off_x * along).max(), np.abs(off_y).max())
    assert worst < 0.002


def test_newton_takes_as_many_steps_as_the_lens_needs():
    k1 = np.linspace(-0.8, 0.4, 241)
    k2 = 0.019 * k1 + 0.805 * k1**2
    lens = np.stack([np.full_like(k1, 1.6), np.full_like(k1, 0.9), k1, k2], -1)
    reach = max_distorted_radius(torch.from_numpy(k1), torch.from_numpy(k2)).numpy()
    lens = lens[np.hypot(1.6, 0.9) < reach]
    steps = newton_steps(lens)
    assert steps.max() < 20
    assert newton_steps(np.array([[0.6, 0.5, 0.0, 0.0]])).tolist() == [0]
    assert steps[0] > steps[-60]  # strong distortion takes more


# -- what is seen ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("antialias", [False, True])
def test_a_crop_is_what_its_exact_rays_see(antialias):
    n, width, height = 24, 48, 36
    draw = LENSES.draw(n, 1)
    panorama = painted(smooth_colour, 512)
    held = Panoramas([panorama], ["a"])
    crops = crop_batch(held, np.zeros(n, int), draw, width, height, antialias=antialias)
    for i in range(n):
        expected = smooth_colour(exact_directions(draw, i, width, height)).numpy().transpose(2, 0, 1)
        # half a grey level of the panorama, half of the crop, and the mean over a pixel that is not its middle
        assert np.abs(np.asarray(crops[i], float) - expected).max() < (1.6 if antialias else 1.2)


def test_tilt_shows_the_sky_roll_turns_and_yaw_pans_right():
    def colour(directions):
        sky = (directions[..., 1] < 0).double() * 255
        right = (directions[..., 0] > 0).double() * 255
        ahead = (directions[..., 2] > 0).double() * 255
        return torch.stack([sky, right, ahead], -1)

    panorama = painted(colour, 256)
    up = crop_panoramas(panorama, camera(tilt=0.5), angles(0.0), 40, 30)[0]
    assert up[0].mean() > 200  # looking up: mostly sky
    level = crop_panoramas(panorama, camera(), angles(0.0), 40, 30)[0]
    assert level[0, :14].min() == 255
    assert level[0, 16:].max() == 0
    rolled = crop_panoramas(panorama, camera(roll=0.3), angles(0.0), 40, 30)[0]
    assert rolled[0, :, :10].mean() > rolled[0, :, -10:].mean() + 50  # the right side is lowered: more ground there
    right = crop_panoramas(panorama, camera(), angles(1.0), 40, 30)[0]
    assert right[1].mean() > 240  # panned to the right


def test_a_turned_panorama_is_a_turned_camera_and_the_seam_is_not_seen():
    rng = np.random.default_rng(0)
    panorama = np.repeat(np.repeat(rng.integers(0, 255, (64, 128, 3), np.uint8), 4, 0), 4, 1)
    n = 12
    cameras = LENSES.draw(n, 2).cameras
    yaw = torch.linspace(-3, 3, n, dtype=torch.float64)
    for columns in (256, 100, 511):
        turned = np.roll(panorama, -columns, axis=1)
        for antialias in (False, True):
            a = crop_panoramas(panorama, cameras, yaw, 64, 48, antialias=antialias)
            b = crop_panoramas(
                np.ascontiguousarray(turned), cameras, yaw - 2 * math.pi * columns / 512, 64, 48, antialias=antialias
            )
            coarse = antialias and columns % 8 != 0  # other pixels are averaged into one of a coarser level
            assert np.abs(a.astype(int) - b).max() <= (40 if coarse else 1)
            assert np.abs(a.astype(int) - b).mean() < (2 if coarse else 0.1)


@pytest.mark.parametrize("tilt", [1.45, -1.45])
def test_across_a_pole(tilt):
    # one colour gradient straight over the pole: rows mirrored at the pole would bend it
    panorama = painted(lambda d: torch.stack([128 + 120 * d[..., 2]] * 3, -1), 32)
    draw = CameraDraw(camera(tilt=tilt, focal=2.0, k1=0.0), angles(0.7), angles(1.0))
    crop = crop_batch(Panoramas([panorama], ["a"]), np.zeros(1, int), draw, 33, 33, antialias=False)
    expected = 128 + 120 * exact_directions(draw, 0, 33, 33)[..., 2].numpy()
    assert np.abs(crop[0, 0] - expected).max() < 2.0


def test_crops_are_squashed_not_cut():
    panorama = painted(smooth_colour, 256)
    wide = crop_panoramas(panorama, camera(), angles(0.3), 96, 48, aspect=angles(2.0), antialias=False)
    squashed = crop_panoramas(panorama, camera(), angles(0.3), 48, 48, aspect=angles(2.0), antialias=False)
    between = (wide[..., ::2].astype(int) + wide[..., 1::2]) / 2
    assert np.abs(between - squashed).max() <= 1


# -- antialiasing ------------------------------------------------------------------------------------------------------


def many_rays(panorama, draw, width, height, side):
    """The mean over each pixel of a grid of central rays in the panorama itself."""
    n = len(draw.yaw)
    fine = crop_batch(
        Panoramas([panorama], ["a"]), np.zeros(n, int), draw, side * width, side * height, antialias=False
    )
    return fine.reshape(n, 3, height, side, width, side).mean((3, 5))


@pytest.mark.parametrize("rows", [128, 512, 2048])
def test_strongly_minified_crops_are_the_mean_of_many_rays(rows):
    """Sharp random blocks, 2 by 2 pixels or more, in crops of 32 x 24: 1.9, 7.5 and 30 panorama pixels a crop pixel."""
    rng = np.random.default_rng(3)
    blocks = rng.integers(0, 2, (rows // 2, rows, 3), np.uint8) * 255
    panorama = np.repeat(np.repeat(blocks, 2, 0), 2, 1)
    draw = CameraDraw(
        camera(n=6, tilt=0.1, roll=0.2, focal=0.9), torch.linspace(-3, 3, 6).double(), angles(*[4 / 3] * 6)
    )
    reference = many_rays(panorama, draw, 32, 24, 16)
    held = Panoramas([panorama], ["a"])
    crops, central = (crop_batch(held, np.zeros(6, int), draw, 32, 24, antialias=flag) for flag in (True, False))
    error, aliased = (np.sqrt(np.mean((c - reference) ** 2)) for c in (crops, central))
    assert error < 8  # of black and white blocks; measured: 6.3, 4.7, 3.6
    assert error < aliased / 4  # measured: 34, 98, 106


def test_rays_follow_the_size_of_a_pixel():
    rays = Rays.of(CameraDraw(camera(n=5), angles(*[0.0] * 5), angles(*[1.0] * 5)), "lopez")
    sampling = Sampling.of(rays, np.array([32, 128, 512, 1024, 8192]), 64, 64)
    assert sampling.level.tolist() == [0, 0, 0, 1, 4]
    assert sampling.side.tolist() == [1, 2, 3, 3, 3]


def test_a_crop_does_not_depend_on_the_rest_of_its_batch():
    rng = np.random.default_rng(2)
    panoramas = Panoramas([rng.integers(0, 255, (rows, 2 * rows, 3), np.uint8) for rows in (64, 256)], "ab")
    which, numbers = np.arange(10) % 2, np.arange(10)
    together = crop_batch(panoramas, which, LENSES.draw_for(which, numbers, 0), 32, 24)
    for i in range(10):
        alone = LENSES.draw_for(which[i : i + 1], numbers[i : i + 1], 0)
        assert np.array_equal(crop_batch(panoramas, which[i : i + 1], alone, 32, 24)[0], together[i])


# -- against the renderer ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_crop_of_a_rendered_panorama_is_the_render_of_its_camera():
    """Tilted, rolled and distorted crops of a panorama of the small town, and the same cameras in the town itself."""
    heading, n = 0.7, 4
    renderer = town_renderer(OVERCAST)
    graph_pose = (*_place(), 1.6)

    def seen_by(rays, *angles_):
        pose = level_camera_pose(*graph_pose, *(torch.tensor(a, dtype=torch.float64) for a in angles_))
        return renderer.picture(rays, pose.numpy(), OVERCAST)

    panorama = seen_by(WorldRays.of_camera(EquirectangularCamera(1536, 768), 4), heading)
    cameras = CameraParameters(
        angles(0.0, 0.3, -0.2, 0.1), angles(0.0, 0.2, -0.4, 0.1), angles(0.6, 0.8, 1.2, 0.9), angles(0, -0.2, -0.4, 0.1)
    )
    yaw = angles(0.0, 1.1, -2.0, 3.0)
    crops = crop_panoramas(panorama, cameras, yaw, 128, 96)
    for i in range(n):
        lens = PerspectiveCamera(cameras.focal[i], cameras.k1[i], k2_of_k1(cameras.k1[i]), 128, 96)
        rays = WorldRays.of_camera(lens, 16)
        direct = seen_by(rays, heading - yaw[i].item(), cameras.tilt[i].item(), cameras.roll[i].item())
        off = seen_by(rays, heading - yaw[i].item(), cameras.tilt[i].item() + 0.01, cameras.roll[i].item())
        crop = crops[i].transpose(1, 2, 0).astype(float)
        difference, wrong = np.abs(crop - direct).mean(), np.abs(crop - off).mean()
        assert difference < 3  # measured: 1.6 to 2.0 grey levels, from the panorama's own 2 x 2 rays a pixel
        assert abs((crop - direct).mean()) < 0.5
        assert difference < wrong / 2  # half a degree of tilt is told apart


def _place():
    from worlds.handmade import small_town

    graph = small_town().graph
    a, b = graph.nodes[graph.edges[2]]
    return tuple(a + 0.4 * (b - a))


def test_on_a_canvas_a_picture_lies_in_the_middle_as_its_camera_sees_it():
    """Beside the picture squashed to its own size: the same pixels, whatever its aspect."""
    held = Panoramas([painted(smooth_colour, 256)], ["a"])
    numbers = list(range(12))
    square = Crops(held, LENSES, 96, 96, seed=0, canvas=True)[numbers]
    for i, aspect in enumerate(square.aspect.tolist()):
        columns, rows = picture_size(96, aspect)
        if columns / rows != pytest.approx(aspect):
            continue  # not of whole pixels
        left, top = (96 - columns) // 2, (96 - rows) // 2
        alone = Crops(held, LENSES, columns, rows, seed=0)[[numbers[i]]]
        assert alone.aspect[0] == square.aspect[i]
        difference = square.images[i, :, top : top + rows, left : left + columns].float() - alone.images[0].float()
        assert difference.abs().mean() < 1
    for kept, expected in zip(square.cameras, Crops(held, LENSES, 48, 36, seed=0)[numbers].cameras, strict=True):
        assert torch.equal(kept, expected)  # of the pictures, not of the squares
