import numpy as np
import pytest
import torch
from baselines.calibration.drawings import cameras, picture

from sextant.baselines.calibration import (
    CombinedGeometry,
    PriorCamera,
    VanishingPoints,
    refine,
)
from sextant.errors import UserError
from sextant.geometry import CameraParameters

CAMERAS = list(cameras(10))
SIGMA = np.array([0.05, 0.03, 0.08, 0.06])


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


def test_pictures_give_all_parameters(pictures):
    found = np.array(
        [errors(CombinedGeometry().calibrate(p).camera, c) for p, c in zip(pictures, CAMERAS, strict=True)]
    )
    assert (np.median(found, axis=0) < [0.3, 0.3, 0.02, 0.02]).all()
    assert (found.max(axis=0) < [1.5, 0.8, 0.1, 0.1]).all()


def test_undoing_the_lens_beats_vanishing_points_that_ignore_it(hard_pictures):
    ours, pinhole, prior = (
        np.mean([errors(m.calibrate(p).camera, c) for p, c in zip(hard_pictures, CAMERAS, strict=True)], axis=0)
        for m in (CombinedGeometry(), VanishingPoints(), PriorCamera())
    )
    assert (ours[2:] < 0.5 * pinhole[2:]).all()
    assert (ours < 0.5 * prior).all()


def network_of(camera, seed):
    tilt, roll, _, focal, k1 = camera
    return camera_of(*np.array([tilt, roll, focal, k1]) + SIGMA * np.random.default_rng(seed).standard_normal(4))


def test_refinement_is_better_than_what_it_starts_from(hard_pictures):
    before, after = [], []
    for index, (image, camera) in enumerate(zip(hard_pictures, CAMERAS, strict=True)):
        start = network_of(camera, index)
        before.append(errors(start, camera))
        after.append(errors(refine(image, start, camera_of(*SIGMA)).camera, camera))
    assert (np.mean(after, axis=0) < 0.7 * np.mean(before, axis=0)).all()


def test_refinement_saves_geometry_where_the_world_has_few_lines():
    geometry, network, refined = [], [], []
    for index, camera in enumerate(cameras(30, seed=9)):
        image = picture(*camera, seed=index, noise=12, clutter=60, samples=2)
        geometry.append(errors(CombinedGeometry().calibrate(image).camera, camera))
        start = network_of(camera, index)
        network.append(errors(start, camera))
        refined.append(errors(refine(image, start, camera_of(*SIGMA)).camera, camera))
    refined, geometry, network = (np.mean(values, axis=0) for values in (refined, geometry, network))
    assert (refined < network).all()
    assert (refined < geometry).all()


def test_without_lines_the_first_estimate_comes_back():
    start = camera_of(0.2, -0.1, 0.9, -0.2)
    estimate = refine(np.full((96, 128, 3), 90, np.uint8), start, camera_of(*SIGMA))
    torch.testing.assert_close(torch.stack(estimate.camera), torch.stack(start))
    torch.testing.assert_close(estimate.sigma.focal, torch.tensor(SIGMA[2]))
    assert not any(estimate.determined)


def test_a_sure_network_is_hardly_moved(pictures):
    start = network_of(CAMERAS[0], 3)
    estimate = refine(pictures[0], start, camera_of(1e-5, 1e-5, 1e-5, 1e-5))
    torch.testing.assert_close(torch.stack(estimate.camera), torch.stack(start), atol=1e-3, rtol=0)


@pytest.mark.parametrize("sigma", [(0.0, 0.1, 0.1, 0.1), (0.1, 0.1, float("nan"), 0.1)])
def test_refinement_needs_uncertainties(sigma):
    with pytest.raises(UserError, match="sigma > 0"):
        refine(np.zeros((8, 8, 3), np.uint8), camera_of(0, 0, 1, 0), camera_of(*sigma))


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 300, 3), (300, 2, 3)])
def test_any_size_of_image_is_taken(shape):
    image = np.random.default_rng(0).integers(256, size=shape).astype(np.uint8)
    assert all(torch.isfinite(value) for value in CombinedGeometry().calibrate(image).camera)


def test_the_same_seed_gives_the_same_camera(hard_pictures):
    assert (
        CombinedGeometry(seed=1).calibrate(hard_pictures[0]).camera
        == CombinedGeometry(seed=1).calibrate(hard_pictures[0]).camera
    )


def test_uncertainty_covers_the_error(hard_pictures):
    ratios = []
    for image, camera in zip(hard_pictures, CAMERAS, strict=True):
        estimate = CombinedGeometry().calibrate(image)
        truth = camera_of(*np.array(camera)[[0, 1, 3, 4]])
        ratios.append([float((a - b) / s) for a, b, s in zip(estimate.camera, truth, estimate.sigma, strict=True)])
    assert (np.median(np.abs(ratios), axis=0) < 1.5).all()
