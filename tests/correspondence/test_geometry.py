"""Poses, points and focal lengths from made-up correspondences, whose truth is known."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

pytest.importorskip("poselib")
from sextant.correspondence import Pinhole, absolute_pose, triangulate
from sextant.correspondence.pinhole import cross_matrices, sampson_errors
from sextant.errors import ArgumentError

CAMERA = Pinhole.centred(640, 480, 520.0)


def scene(rng, n=120):
    """Points in front of a camera near the origin, and its pose."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(rng.normal(scale=0.2, size=3)).as_matrix(), rng.normal(size=3)
    inside = np.column_stack([rng.uniform(-2, 2, n), rng.uniform(-1.5, 1.5, n), rng.uniform(4, 9, n)])
    return pose, inside @ pose[:3, :3].T + pose[:3, 3], inside


def error_of(found, pose):
    """Displacement and rotation vector from the truth, in the axes of the camera."""
    between = np.linalg.inv(pose) @ found.world_from_camera
    return np.concatenate([between[:3, 3], Rotation.from_matrix(between[:3, :3]).as_rotvec()])


def test_regions_of_poses_hold_the_truth_as_often_as_they_say():
    """95 % regions of six unknowns, from pixels with noise and points with their own covariance."""
    held = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        pose, points, inside = scene(rng)
        covariances = np.tile(np.diag([0.01, 0.01, 0.03]) ** 2, (len(points), 1, 1))
        known = points + rng.normal(size=points.shape) * [0.01, 0.01, 0.03]
        pixels = CAMERA.project(inside) + rng.normal(scale=0.8, size=(len(points), 2))
        found = absolute_pose(pixels, known, CAMERA, covariances=covariances, error_px=8)
        error = error_of(found, pose)
        held.append(error @ np.linalg.solve(found.covariance, error) < stats.chi2.ppf(0.95, 6))
    assert 0.90 <= np.mean(held) <= 0.985  # binomial noise of 200 runs about 0.95


def test_a_pose_is_found_among_two_thirds_of_wrong_matches():
    rng = np.random.default_rng(0)
    pose, points, inside = scene(rng, 150)
    pixels = CAMERA.project(inside) + rng.normal(scale=0.5, size=(150, 2))
    pixels[50:] = rng.uniform((0, 0), (640, 480), (100, 2))
    found = absolute_pose(pixels, points, CAMERA)
    assert np.linalg.norm(error_of(found, pose)[:3]) < 0.05
    assert found.inliers[:50].sum() >= 48
    assert found.inliers[50:].sum() <= 3


@pytest.mark.parametrize(("given", "sigma"), [(900.0, None), (560.0, 0.1)])
def test_an_unknown_focal_length_is_estimated_with_the_pose(given, sigma):
    errors = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        pose, points, inside = scene(rng, 200)
        pixels = CAMERA.project(inside) + rng.normal(scale=0.5, size=(200, 2))
        found = absolute_pose(pixels, points, CAMERA.of_focal_length(given), focal_sigma=sigma)
        errors.append((np.log(found.camera.fx / 520.0) / found.focal_sigma, np.linalg.norm(error_of(found, pose)[:3])))
        assert found.camera.fx == pytest.approx(520.0, rel=0.02)
    errors = np.array(errors)
    assert np.abs(errors[:, 0]).max() < 4
    assert errors[:, 1].max() < 0.1


def test_what_no_pose_explains_has_none():
    rng = np.random.default_rng(0)
    assert absolute_pose(rng.uniform(0, 400, (3, 2)), rng.normal(size=(3, 3)), CAMERA) is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"points": np.zeros((4, 3))}, r"points has the shape \(4, 3\), but must have \(5, 3\)"),
        ({"pixels": np.zeros((5, 3))}, r"pixels has the shape \(5, 3\), but must have \(n, 2\)"),
        ({"covariances": np.zeros((4, 3, 3))}, r"covariances has the shape \(4, 3, 3\)"),
        ({"focal_sigma": -1.0}, "focal_sigma=-1.0 must be at least 0"),
        ({"focal_sigma": np.nan}, "focal_sigma=nan must be"),
        ({"error_px": 0}, "error_px=0 must be above 0"),
        ({"error_px": np.nan}, "error_px=nan must be"),
    ],
)
def test_matches_without_a_meaning_have_no_pose(given, said):
    matches = {"pixels": np.zeros((5, 2)), "points": np.zeros((5, 3)), "camera": CAMERA}
    with pytest.raises(ArgumentError, match=said):
        absolute_pose(**matches | given)


def test_points_are_triangulated_with_their_uncertainty():
    rng = np.random.default_rng(1)
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = [0, 0.5, 1, 1.5]
    points = np.column_stack([rng.uniform(-1, 2, 80), rng.uniform(-1, 1, 80), rng.uniform(4, 8, 80)])
    pixels = np.concatenate([CAMERA.project(points - pose[:3, 3]) for pose in poses])
    images, tracks = np.repeat(np.arange(4), 80), np.tile(np.arange(80), 4)
    noisy = pixels + rng.normal(size=pixels.shape)
    found = triangulate(noisy, images, tracks, poses, [CAMERA] * 4)
    error = found.points - points
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariances), error)
    assert found.valid.all()
    assert stats.kstest(normalised, stats.chi2(3).cdf).pvalue > 0.001
    exact = triangulate(pixels, images, tracks, poses, [CAMERA] * 4)
    np.testing.assert_allclose(exact.points, points, atol=1e-6)


def test_tracks_of_fewer_than_two_pixels_are_not_valid():
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 1
    pixels, cameras = np.array([[419.5, 239.5], [319.5, 239.5], [300.0, 200.0]]), [CAMERA] * 2
    found = triangulate(pixels, np.array([0, 1, 0]), np.array([1, 1, 3]), poses, cameras)
    assert found.valid.tolist() == [False, True, False, False]
    with pytest.raises(ArgumentError, match=r"images has the shape \(2,\), but must have \(3,\)"):
        triangulate(pixels, np.array([0, 1]), np.array([1, 1, 3]), poses, cameras)


def test_errors_of_matches_are_distances_from_their_epipolar_lines():
    """By a sideways motion these are rows: a second pixel d below its row is d / sqrt(2) from agreeing, both moved."""
    _, _, inside = scene(np.random.default_rng(0), 50)
    one, two = (CAMERA.rays(CAMERA.project(each))[:, :2] for each in (inside, inside - [0.3, 0, 0]))
    essential = cross_matrices(np.array([[-1.0, 0, 0]]))[0]
    np.testing.assert_allclose(sampson_errors(one, two, essential), 0, atol=1e-12)
    off = sampson_errors(one, np.add(two, [0, 0.01]), essential)
    np.testing.assert_allclose(np.abs(off), 0.01 / np.sqrt(2), rtol=1e-9)


@pytest.mark.parametrize(("key", "value"), [("fx", 0.0), ("width", 0), ("cx", np.nan)])
def test_an_impossible_camera_is_refused(key, value):
    arguments = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0} | {key: value}
    with pytest.raises(ArgumentError, match="must be"):
        Pinhole(**arguments)


@pytest.mark.parametrize("baseline", [0.0, 1e-9, 1e-3])
def test_equal_pixels_of_two_images_have_no_depth_and_are_no_error(baseline):
    pixels = np.random.default_rng(0).uniform(0, 480, (50, 2))
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = baseline
    tracks, images = np.repeat(np.arange(50), 2), np.tile([0, 1], 50)
    found = triangulate(pixels[tracks], images, tracks, poses, [CAMERA] * 2)
    assert found.angles_deg.max() < 1e-3
    assert np.isfinite(found.covariances).all()
