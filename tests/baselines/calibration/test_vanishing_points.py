import numpy as np
import pytest
from baselines.calibration.drawings import cameras, picture, segments

from sextant.baselines.calibration import CameraPrior, VanishingPoints, detect_segments
from sextant.baselines.calibration.line_segments import longest_first
from sextant.baselines.calibration.vanishing_points import explained_share

CAMERAS = list(cameras(8, k1=(0, 0)))


def errors(estimate, camera):
    """Tilt and roll in degrees, focal length relative."""
    tilt, roll, focal, _ = (float(value) for value in estimate.camera)
    return np.degrees(abs(tilt - camera[0])), np.degrees(abs(roll - camera[1])), abs(focal / camera[3] - 1)


def median_errors(**kind):
    solver = VanishingPoints()
    found = [errors(solver.calibrate_segments(segments(*c, seed=i, **kind)), c) for i, c in enumerate(CAMERAS)]
    return np.median(found, axis=0)


@pytest.mark.parametrize("camera", CAMERAS)
def test_exact_segments_give_the_exact_camera(camera):
    estimate = VanishingPoints().calibrate_segments(segments(*camera, count=80))
    tilt, roll, focal = errors(estimate, camera)
    assert max(tilt, roll) < 0.1
    assert focal < 0.01
    assert estimate.determined[:3] == (True, True, True)


@pytest.mark.slow
def test_more_noise_more_error():
    error = [median_errors(noise=noise)[0] for noise in (0.0, 0.001, 0.004, 0.015)]
    assert error == sorted(error)
    assert error[0] < 0.05 < 0.5 < error[-1]


def test_two_fifths_of_outliers_are_borne():
    assert (median_errors(outliers=0.4) < [0.3, 0.3, 0.02]).all()


@pytest.mark.parametrize("index", range(6))
def test_a_picture_gives_the_camera(index):
    camera = CAMERAS[index]
    estimate = VanishingPoints().calibrate(picture(*camera, seed=index))
    tilt, roll, focal = errors(estimate, camera)
    assert max(tilt, roll) < 0.5
    assert focal < 0.03


def test_a_mirrored_picture_has_the_opposite_roll():
    camera = CAMERAS[2]
    image = picture(*camera, seed=2)
    one, other = (VanishingPoints().calibrate(np.ascontiguousarray(i)) for i in (image, image[:, ::-1]))
    assert float(one.camera.roll) == pytest.approx(-float(other.camera.roll), abs=4e-3)
    assert float(one.camera.tilt) == pytest.approx(float(other.camera.tilt), abs=4e-3)


def test_a_frontal_view_determines_the_roll_but_not_the_focal_length():
    ends = segments(0.0, 0.05, 0.0, 0.8, count=60, noise=0.001)
    flat = ends[np.abs(ends.mean(1)).max(-1) < 10]
    across = np.abs(flat[:, 1] - flat[:, 0]).min(-1) < 0.12 * np.abs(flat[:, 1] - flat[:, 0]).max(-1)
    estimate = VanishingPoints(CameraPrior(focal=1.1)).calibrate_segments(flat[across])
    assert estimate.camera.roll == pytest.approx(0.05, abs=0.01)
    assert estimate.determined.roll
    assert not estimate.determined.focal
    assert estimate.camera.focal == pytest.approx(1.1, rel=0.15)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_hardly_any_segments_leave_the_prior(count):
    camera = CAMERAS[0]
    prior = CameraPrior(focal=1.1)
    estimate = VanishingPoints(prior).calibrate_segments(segments(*camera, count=60)[:count])
    assert all(np.isfinite(float(value)) for value in estimate.camera)
    assert not estimate.determined.k1
    if count < 3:
        assert estimate.camera.focal == pytest.approx(1.1)
        assert not any(estimate.determined)


def test_identical_and_collinear_segments_do_no_harm():
    same = np.repeat(np.array([[[-0.2, 0.1], [0.3, 0.15]]]), 12, axis=0)
    estimate = VanishingPoints().calibrate_segments(same)
    assert all(np.isfinite(float(value)) for value in estimate.camera)
    assert not estimate.determined.focal


def test_the_same_seed_gives_the_same_camera():
    ends = detect_segments(picture(*CAMERAS[1], noise=10, clutter=8, samples=2))
    assert (
        VanishingPoints(seed=3).calibrate_segments(ends).camera
        == VanishingPoints(seed=3).calibrate_segments(ends).camera
    )


def test_fit_takes_the_focal_length_of_the_training_cameras():
    import torch

    from sextant.geometry import CameraParameters

    cameras_ = CameraParameters(*(torch.tensor([a, b]) for a, b in ((0.3, 0.4), (0.1, 0.2), (1.5, 1.5), (0.0, -0.1))))
    blank = np.zeros((64, 64, 3), np.uint8)
    estimate = VanishingPoints().fit(cameras_).calibrate(blank)
    assert [float(value) for value in estimate.camera] == pytest.approx([0, 0, 1.5, 0], abs=1e-6)


@pytest.mark.slow
def test_pictures_give_the_camera_to_a_third_of_a_degree_in_the_median():
    found = [errors(VanishingPoints().calibrate(picture(*c, seed=i)), c) for i, c in enumerate(CAMERAS)]
    assert (np.median(found, axis=0) < [0.3, 0.3, 0.02]).all()


@pytest.mark.parametrize("count", [4, 6, 8, 30, 120])
def test_any_segments_are_explained_by_chance_and_no_more(count):
    """The best of 500 frames explains all of four twigs, and most of eight."""
    rng = np.random.default_rng(count)
    middle, turn, length = (
        rng.uniform(-0.5, 0.5, (count, 2)),
        rng.uniform(0, np.pi, count),
        rng.uniform(0.1, 0.3, count),
    )
    half = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * length[:, None] / 2
    assert explained_share(longest_first(np.stack([middle - half, middle + half], 1)), CameraPrior(), seed=0) < 0.25
    room = segments(0.2, 0.05, 0.4, 0.9, count=count)
    assert explained_share(room, CameraPrior(), seed=0) > (0.7 if count > 8 else -1)
