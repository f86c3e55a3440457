import numpy as np
import pytest
import torch
from baselines.calibration.drawings import cameras, picture

from sextant.baselines.calibration import CombinedGeometry, PriorCamera, VanishingPoints
from sextant.geometry import CameraParameters

CAMERAS = list(cameras(10))


def camera_of(*values):
    return CameraParameters(*torch.tensor(values, dtype=torch.float64).unbind())


def errors(found, camera):
    """Degrees of tilt and roll, relative focal length, k1_hat."""
    tilt, roll, focal, k1 = (float(value) for value in found)
    t, r, _, f, k = camera
    return [np.degrees(abs(tilt - t)), np.degrees(abs(roll - r)), abs(focal / f - 1), abs(k1 / focal**2 - k / f**2)]


@pytest.fixture(scope="module")
def pictures():
    return [picture(*camera, seed=index) for index, camera in enumerate(CAMERAS)]


@pytest.fixture(scope="module")
def hard_pictures():
    return [picture(*camera, seed=index, noise=8, clutter=12) for index, camera in enumerate(CAMERAS)]


@pytest.mark.slow
def test_pictures_give_all_parameters(pictures):
    found = np.array(
        [errors(CombinedGeometry().calibrate(p).camera, c) for p, c in zip(pictures, CAMERAS, strict=True)]
    )
    assert (np.median(found, axis=0) < [0.3, 0.3, 0.02, 0.02]).all()
    assert (found.max(axis=0) < [1.5, 0.8, 0.1, 0.1]).all()


@pytest.mark.slow
def test_undoing_the_lens_beats_vanishing_points_that_ignore_it(hard_pictures):
    ours, pinhole, prior = (
        np.mean([errors(m.calibrate(p).camera, c) for p, c in zip(hard_pictures, CAMERAS, strict=True)], axis=0)
        for m in (CombinedGeometry(), VanishingPoints(), PriorCamera())
    )
    assert (ours[2:] < 0.5 * pinhole[2:]).all()
    assert (ours < 0.5 * prior).all()


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 300, 3), (300, 2, 3)])
def test_any_size_of_image_is_taken(shape):
    image = np.random.default_rng(0).integers(256, size=shape).astype(np.uint8)
    assert all(torch.isfinite(value) for value in CombinedGeometry().calibrate(image).camera)


def test_the_same_seed_gives_the_same_camera(hard_pictures):
    assert (
        CombinedGeometry(seed=1).calibrate(hard_pictures[0]).camera
        == CombinedGeometry(seed=1).calibrate(hard_pictures[0]).camera
    )


@pytest.mark.slow
def test_uncertainty_covers_the_error(hard_pictures):
    ratios = []
    for image, camera in zip(hard_pictures, CAMERAS, strict=True):
        estimate = CombinedGeometry().calibrate(image)
        truth = camera_of(*np.array(camera)[[0, 1, 3, 4]])
        ratios.append([float((a - b) / s) for a, b, s in zip(estimate.camera, truth, estimate.sigma, strict=True)])
    assert (np.median(np.abs(ratios), axis=0) < 1.5).all()
