import math

import numpy as np
import pytest
import torch

from sextant.chapters.calibration.figures.overlay import horizon_curve
from sextant.geometry import PerspectiveCamera, horizon_points, k2_of_k1, rho_from_tilt


def number(value):
    return torch.tensor(value, dtype=torch.float64)


@pytest.mark.parametrize("k1", [-0.4, -0.1, 0.0])
def test_the_horizon_is_that_of_the_camera_and_passes_through_its_foot(k1):
    tilt, roll, focal, bend = (number(v) for v in (0.2, 0.3, 0.7, k1))
    k2 = k2_of_k1(bend)
    curve = horizon_curve(tilt, roll, focal, bend, k2)
    camera = PerspectiveCamera(focal, bend, k2, 640, 480)
    azimuths = torch.linspace(-math.pi / 2, math.pi / 2, len(curve) + 2, dtype=torch.float64)[1:-1]
    pixels, visible = horizon_points(camera, tilt, roll, azimuths)
    expected = ((pixels - torch.tensor([320.0, 240.0])) / 480).numpy()
    np.testing.assert_allclose(curve[visible], expected[visible.numpy()], atol=1e-9)
    assert np.isnan(curve[~visible]).all()
    rho = rho_from_tilt(tilt, focal, bend, k2).item()
    nearest = curve[np.nanargmin(np.linalg.norm(curve, axis=1))]
    np.testing.assert_allclose(nearest, [rho * math.sin(0.3), rho * math.cos(0.3)], atol=2e-3)


def test_what_lies_out_of_reach_is_left_out():
    flat = [number(v) for v in (0.0, 0.0, 1.0, 0.0, 0.0)]
    assert np.nanmax(np.abs(horizon_curve(*flat))) > 100
    assert 1.9 < np.nanmax(np.abs(horizon_curve(*flat, reach=2.0))) < 2.0


def test_a_lens_that_folds_inside_the_image_still_has_a_horizon():
    curve = horizon_curve(*(number(v) for v in (0.0, 0.0, 0.3, -0.5, 0.0)), points=361)
    assert np.isnan(curve).any()
    assert np.isfinite(curve[len(curve) // 2]).all()
