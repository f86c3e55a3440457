import io
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from figures.written import legend_of

from sextant.chapters.calibration.figures.overlay import (
    CalibratedPhoto,
    calibration_overlay,
    distortion_grid,
    gravity_arrows,
    photo_sheet,
)
from sextant.figures.style import save_figure
from sextant.geometry import perspective_bearings, rho_from_tilt, up_in_camera

WHOLE = (0.0, 0.0, 1.0, 1.0)


def photo(tilt=0.1, roll=-0.15, focal=0.7, k1=-0.25, size=(60, 80), seen=WHOLE):
    k2 = 0.019 * k1 + 0.805 * k1 * k1
    return CalibratedPhoto(np.full((*size, 3), 90, np.uint8), tilt, roll, focal, k1, k2, seen, ("a", "b"))


def rays(p, points):
    return perspective_bearings(torch.from_numpy(points), *p.lens())


@pytest.mark.parametrize("tilt", [-0.3, 0.0, 0.2])
def test_rays_through_the_horizon_are_level(tilt):
    p = photo(tilt)
    curve = p.horizon()
    curve = curve[np.abs(curve).max(1) < 0.7]
    assert len(curve) > 100
    up = up_in_camera(torch.tensor(p.tilt), torch.tensor(p.roll)).double()
    assert (rays(p, curve) @ up).abs().max() < 1e-7


def test_the_horizon_passes_its_foot_below_the_centre_when_looking_up():
    p = photo(0.2, -0.15)
    rho = float(rho_from_tilt(torch.tensor(p.tilt), *p.lens()))
    distance = np.hypot(*p.horizon().T)
    assert np.nanmin(distance) == pytest.approx(rho, rel=1e-5)
    nearest = p.horizon()[np.nanargmin(distance)]
    np.testing.assert_allclose(nearest, [rho * math.sin(p.roll), rho * math.cos(p.roll)], atol=1e-3)
    assert nearest[1] > 0


def test_a_level_undistorted_camera_has_a_level_horizon_and_upright_arrows():
    p = photo(0.0, 0.0, k1=0.0)
    curve = p.horizon()
    assert np.nanmax(np.abs(curve[:, 1])) < 1e-12
    _, down = gravity_arrows(p)
    np.testing.assert_allclose(down, np.tile([0.0, 1.0], (len(down), 1)), atol=1e-4)


def test_arrows_point_away_from_the_zenith():
    p = photo(0.6, 0.2, focal=0.5, k1=0.0)
    up = up_in_camera(torch.tensor(p.tilt), torch.tensor(p.roll)).double().numpy()
    zenith = p.focal * up[:2] / up[2]  # without distortion arrows lie on lines through it
    points, down = gravity_arrows(p)
    away = points - zenith
    np.testing.assert_allclose(down, away / np.hypot(*away.T)[:, None], atol=1e-3)


def test_lines_of_the_grid_are_straight_where_the_lens_does_not_bend():
    for p in (photo(), photo(k1=0.0)):
        bows = []
        for line in distortion_grid(p):
            line = line[np.isfinite(line[:, 0])]
            if len(line) > 20:
                straight = rays(p, line).numpy()
                straight = straight[:, :2] / straight[:, 2:]
                centred = straight - straight.mean(0)
                assert np.linalg.svd(centred)[1][1] < 1e-6  # in the scene
                bows.append(np.linalg.svd(line - line.mean(0))[1][1])
        assert (max(bows) > 0.05) == (p.k1 != 0)  # in the picture


@pytest.mark.parametrize(
    "p", [photo(), photo(0.0, 0.0, 0.2, -0.02, (400, 90)), photo(0.1, 0.1, 0.05, 0.4), photo(k1=-0.04)]
)
def test_the_grid_covers_the_picture_with_a_bounded_number_of_lines(p):
    lines = distortion_grid(p)
    assert 8 <= len(lines) <= 2 * (60 + 3)
    assert np.nanmax(np.abs(np.concatenate(lines)[:, 1])) >= 0.45


@pytest.mark.parametrize(
    ("p", "text"),
    [
        (photo(), "horizon (in the picture)"),
        (photo(1.2, 0.0), "horizon (below the picture)"),
        (photo(seen=(0.1, 0.0, 0.8, 1.0)), "input of the network"),
    ],
)
def test_the_legend_says_what_is_drawn(p, text):
    figure = calibration_overlay(p)
    labels = legend_of(figure.axes[0])
    assert text in labels
    assert ("input of the network" in labels) == (p.seen != WHOLE)
    figure.savefig(io.BytesIO())


@pytest.mark.parametrize(
    ("tilt", "roll", "size", "side"),
    [
        (60, 0, (60, 80), "below"),
        (-60, 0, (60, 80), "above"),
        (60, 180, (60, 80), "above"),
        (60, 90, (60, 80), "to the right of"),
        (-60, 90, (60, 80), "to the left of"),
        (60, 50, (60, 60), "to the right of"),
        (60, 50, (60, 120), "below"),  # so wide a picture ends first below
    ],
)
def test_a_horizon_outside_lies_where_the_ground_begins(tilt, roll, size, side):
    p = photo(math.radians(tilt), math.radians(roll), k1=0.0, size=size)
    assert p.horizon_is() == f"{side} the picture"
    p = replace(p, focal=5.0)  # without distortion the nearest point of the horizon is at f tan(tilt) along the foot
    assert p.horizon_is() == f"{side} the picture"


@pytest.mark.parametrize("size", [(32, 2000), (2000, 32), (60, 80), (40, 40)])
def test_any_shape_is_drawn(tmp_path, size):
    (path,) = save_figure(calibration_overlay(photo(size=size)), tmp_path, "overlay")
    assert path.stat().st_size > 1000


def test_a_sheet_has_a_cell_a_photo():
    figure = photo_sheet([photo()] * 5)
    drawn = [axes for axes in figure.axes if axes.images]
    assert len(drawn) == 5
    assert all(axes.get_title(loc="left") == "a\nb" for axes in drawn)
