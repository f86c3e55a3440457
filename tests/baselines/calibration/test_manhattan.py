import numpy as np
import pytest
from baselines.calibration.drawings import camera_from_room, cameras, segments
from scipy.optimize import approx_fprime, minimize

from sextant.baselines.calibration import CameraPrior
from sextant.baselines.calibration.manhattan import (
    BELIEFS,
    AlignedSegments,
    Normal,
    camera_axes,
    fit_manhattan,
    nearest_axis,
    sines,
)
from sextant.baselines.calibration.robust_fit import RobustFit

WIDE = CameraPrior(sigma=(10.0, 10.0, 10.0, 10.0))


def vector(tilt, roll, heading, focal, k1):
    return np.array([tilt, roll, heading, np.log(focal), k1 / focal**2])


@pytest.mark.parametrize("camera", list(cameras(5)))
def test_axes_are_those_of_the_packages_rotation(camera):
    expected = camera_from_room(*camera[:3])
    np.testing.assert_allclose(camera_axes(vector(*camera)[None])[0], expected, atol=1e-12)


@pytest.mark.parametrize("camera", list(cameras(5, k1=(0, 0))))
def test_edges_of_boxes_point_to_their_vanishing_point_exactly(camera):
    ends = segments(*camera, count=80)
    nearest = np.abs(sines(vector(*camera)[None], ends)[0]).min(axis=0)
    assert nearest.max() < 1e-9


@pytest.mark.parametrize("camera", list(cameras(4)))
def test_the_fit_from_nearby_finds_the_camera(camera):
    truth = vector(*camera)
    ends = segments(*camera, count=80, seed=3)
    # chords of bent edges are straight only once the lens is undone; their ends are exact
    fit = fit_manhattan(ends, truth + np.array([0.02, -0.02, 0.02, 0.05, 0.05]), WIDE, bent=True)
    np.testing.assert_allclose(fit.vector, truth, atol=1e-3)
    assert fit.inliers == len(ends)


def test_the_fit_is_the_minimum_that_another_optimizer_finds():
    camera = next(iter(cameras(1, seed=5)))
    ends = segments(*camera, count=50, noise=0.002, seed=1)
    prior = CameraPrior(focal=1.2, sigma=(0.2, 0.1, 0.1, 0.1))
    start = vector(*camera)
    axis, near = nearest_axis(start, ends)
    terms = [AlignedSegments(ends[near], axis[near], 0.5), Normal(prior)]
    fit = RobustFit(terms, np.arange(5), start, tolerance=1e-6, evaluations=20)
    ours = fit.solve(start)
    assert fit.cost(ours) <= minimize(fit.cost, start, method="Nelder-Mead", options={"maxiter": 4000}).fun + 1e-4
    np.testing.assert_allclose(approx_fprime(ours, fit.cost, 1e-6), 0, atol=0.2)


def test_without_segments_the_fit_is_the_prior_and_its_covariance():
    prior = CameraPrior(0.1, -0.05, 0.9, -0.1, (0.2, 0.1, 0.3, 0.2))
    start = vector(0.0, 0.0, 0.3, 1.0, 0.0)
    fit = fit_manhattan(np.zeros((0, 2, 2)), start, prior, bent=True)
    np.testing.assert_allclose(fit.vector[BELIEFS], prior.vector, atol=1e-5)
    np.testing.assert_allclose(np.diag(fit.covariance)[BELIEFS], np.square(prior.sigma), rtol=1e-6)


def test_more_segments_make_it_surer_up_to_a_limit():
    camera = next(iter(cameras(1, k1=(0, 0))))
    ends = segments(*camera, count=400, noise=0.001)
    order = np.random.default_rng(0).permutation(len(ends))
    sigma = [
        np.sqrt(fit_manhattan(ends[order[:count]], vector(*camera), CameraPrior(), bent=False).covariance[0, 0])
        for count in (5, 20, 80, 320)
    ]
    assert sigma[0] > sigma[1] > 0
    assert sigma[3] == pytest.approx(sigma[2], rel=0.35)
