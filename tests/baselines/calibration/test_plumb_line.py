import numpy as np
import pytest
from baselines.calibration.drawings import cameras, picture

from sextant.baselines.calibration import CameraPrior, PlumbLine
from sextant.baselines.calibration.lens import apparent_k2, distort_points
from sextant.baselines.calibration.plumb_line import deviations, straightening_k1_hat

CAMERAS = list(cameras(8))


def bent_lines(k1_hat, count=30, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-0.7, 0.7, (count, 2, 2))
    points = ends[:, :1] + np.linspace(0, 1, 16)[:, None] * (ends[:, 1:] - ends[:, :1])
    return distort_points(points, k1_hat, float(apparent_k2(k1_hat, 0.87))) + rng.normal(0, noise, points.shape)


@pytest.mark.parametrize("k1_hat", [-0.9, -0.4, -0.1, 0.0, 0.15])
def test_bent_lines_give_their_lens(k1_hat):
    found, sigma = straightening_k1_hat(bent_lines(k1_hat), CameraPrior())
    assert found == pytest.approx(k1_hat, abs=0.005)
    assert sigma < 0.1


def test_lines_are_straight_behind_their_lens_alone_at_any_scale():
    chains = bent_lines(-0.4)
    off = deviations(chains, np.array([-0.8, -0.4, 0.0]), 0.87).mean(axis=1)
    assert off[1] < 1e-6 < 1e-3 < min(off[0], off[2])


def test_curves_of_the_world_count_little():
    angle = np.linspace(0, 2, 16)
    arcs = np.stack([0.3 * np.cos(angle), 0.3 * np.sin(angle)], axis=-1) + np.random.default_rng(1).uniform(
        -0.2, 0.2, (10, 1, 2)
    )
    found, _ = straightening_k1_hat(np.concatenate([bent_lines(-0.3), arcs]), CameraPrior())
    assert found == pytest.approx(-0.3, abs=0.02)


def test_lines_through_the_centre_say_nothing():
    angle = np.linspace(0, np.pi, 12, endpoint=False)[:, None]
    chains = np.linspace(-0.4, 0.4, 16)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    prior = CameraPrior(k1_hat=-0.1, sigma=(0.3, 0.15, 0.4, 0.2))
    found, sigma = straightening_k1_hat(chains, prior)
    assert found == pytest.approx(-0.1, abs=0.01)
    assert sigma == pytest.approx(0.2, rel=0.1)


def test_no_chains_leave_the_prior():
    estimate = PlumbLine(CameraPrior(k1_hat=-0.1)).calibrate(np.zeros((48, 64, 3), np.uint8))
    assert estimate.camera.k1 == pytest.approx(-0.1 * 0.87**2)
    assert not any(estimate.determined)


@pytest.mark.slow
def test_pictures_give_their_lens():
    errors = []
    for index, camera in enumerate(CAMERAS):
        found = PlumbLine().calibrate(picture(*camera, seed=index)).camera
        errors.append(abs(float(found.k1 / found.focal**2) - camera[4] / camera[3] ** 2))
    assert np.median(errors) < 0.02


def test_more_noise_more_error():
    error = [
        np.median([abs(straightening_k1_hat(bent_lines(-0.3, 12, n, s), CameraPrior())[0] + 0.3) for s in range(9)])
        for n in (0.0, 0.001, 0.004)
    ]
    assert error == sorted(error)
