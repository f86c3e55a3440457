"""A level picture shows each direction where a level camera without distortion would."""

import math

import numpy as np
import pytest
import torch

from sextant.data.photos.straightening import STEEPEST, level_photo
from sextant.geometry import perspective_bearings, rotation_from_tilt_roll

WIDTH, HEIGHT, FOCAL = 160, 120, 130.0


def taken(colour, tilt, roll, k1=0.0, k2=0.0):
    """What a camera sees of a world that has a colour for each direction in the gravity frame."""
    v, u = torch.meshgrid(
        (torch.arange(HEIGHT, dtype=torch.float64) + 0.5) / HEIGHT - 0.5,
        ((torch.arange(WIDTH, dtype=torch.float64) + 0.5) - WIDTH / 2) / HEIGHT,
        indexing="ij",
    )
    lens = torch.tensor([FOCAL / HEIGHT, k1, k2], dtype=torch.float64)
    rays = perspective_bearings(torch.stack([u, v], -1), *lens)
    rotation = rotation_from_tilt_roll(*torch.tensor([tilt, roll], dtype=torch.float64))
    return np.asarray(colour((rays @ rotation.T).unbind(-1))).astype(np.uint8)


def by_azimuth(ray):
    x, _, z = ray
    shade = 127 + 100 * torch.sin(8 * torch.atan2(x, z))
    return torch.stack([shade] * 3, -1)


def by_elevation(ray):
    x, y, z = ray
    shade = 127 + 100 * torch.sin(8 * torch.atan2(y, torch.hypot(x, z)))
    return torch.stack([shade] * 3, -1)


@pytest.mark.parametrize(("tilt", "roll", "k1"), [(0, 0.3, 0), (0.3, 0, 0), (-0.25, -0.2, 0), (0.2, 0.15, -0.2)])
def test_what_is_vertical_stands_upright(tilt, roll, k1):
    level, undone = level_photo(taken(by_azimuth, tilt, roll, k1), tilt, roll, FOCAL, k1, 0)
    assert undone
    shades = np.ma.array(level[..., 0].astype(float), mask=level[..., 3] < 255)
    assert shades.count() > 0.6 * shades.size
    assert shades.std(axis=0).max() < 4  # each column is one azimuth
    assert shades.std(axis=1).min() > 20


def test_of_a_steep_camera_the_horizon_is_level_and_the_tilt_stays():
    tilt, roll = STEEPEST + 0.1, 0.3
    level, undone = level_photo(taken(by_azimuth, tilt, roll), tilt, roll, FOCAL, 0, 0)
    assert not undone
    expected = taken(by_azimuth, tilt, 0)
    seen = level[..., 3] == 255
    assert np.abs(level[..., :3].astype(int) - expected)[seen].mean() < 2


def test_a_level_camera_without_distortion_keeps_its_picture():
    image = taken(by_elevation, 0, 0)
    level, undone = level_photo(image, 0.0, 0.0, FOCAL, 0.0, 0.0)
    assert undone
    np.testing.assert_array_equal(level[..., :3], image)
    assert (level[..., 3] == 255).all()


def test_what_the_photo_does_not_show_is_transparent():
    level, _ = level_photo(np.full((HEIGHT, WIDTH, 3), 200, np.uint8), 0.0, math.radians(20), FOCAL, 0.0, 0.0)
    assert level[0, 0, 3] == 0
    assert level[HEIGHT // 2, WIDTH // 2, 3] == 255
