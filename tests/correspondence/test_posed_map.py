"""Maps of made-up features at known poses: what is triangulated, found again, and not found."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

pytest.importorskip("poselib")
from sextant.correspondence import (
    LocalFeatures,
    Pinhole,
    PoseErrors,
    build_map,
    calibrated,
    focal_length_of,
    likely_convention,
    log_false_alarms,
    mutual_matches,
)
from sextant.correspondence.left_out import squared_error, without
from sextant.correspondence.posed_map import neighbouring
from sextant.errors import ArgumentError

CAMERA = Pinhole.centred(640, 480, 520.0)


def views(poses, points, noise=0.3, seed=0):
    """Features of points as each camera sees them, in another order in each image."""
    rng = np.random.default_rng(seed)
    described = rng.normal(size=(len(points), 64))
    described /= np.linalg.norm(described, axis=1, keepdims=True)
    found = []
    for pose in poses:
        pixels = CAMERA.project((points - pose[:3, 3]) @ pose[:3, :3])
        seen = np.flatnonzero(((pixels >= 0) & (pixels < (640, 480))).all(1))
        seen = rng.permutation(seen)
        noisy = pixels[seen] + rng.normal(scale=noise, size=(len(seen), 2))
        found.append(LocalFeatures(noisy.astype(np.float32), described[seen].astype(np.float16), 640, 480))
    return found


@pytest.fixture(scope="module")
def world():
    rng = np.random.default_rng(3)
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.linspace(0, 3, 6)
    points = np.column_stack([rng.uniform(-2, 5, 400), rng.uniform(-2, 2, 400), rng.uniform(4, 9, 400)])
    return poses, points


def test_a_view_between_the_maps_images_is_located(world):
    poses, points = world
    between = np.eye(4)
    between[:3, 3] = (1.23, 0.2, -0.4)
    *mapped, query = views([*poses, between], points)
    posed = build_map(mapped, poses, [CAMERA] * 6)
    assert len(posed.points) > 250
    found = posed.locate(query, range(6), CAMERA)
    assert np.linalg.norm(found.pose.world_from_camera[:3, 3] - between[:3, 3]) < 0.02
    assert found.log10_false_alarms < -100
    unknown = posed.locate(query, range(6), CAMERA.of_focal_length(800.0), None)
    assert unknown.pose.camera.fx == pytest.approx(520, rel=0.02)


def test_the_uncertainty_of_points_is_in_the_pixels_of_the_maps_pictures(world):
    poses, points = world
    fine = views(poses, points)
    coarse = [replace(each, pixel=6.0) for each in views(poses, points, noise=6 * 0.3)]
    one, other = (build_map(each, poses, [CAMERA] * 6) for each in (fine, coarse))
    ratio = np.trace(other.covariances, axis1=1, axis2=2).mean() / np.trace(one.covariances, axis1=1, axis2=2).mean()
    assert ratio == pytest.approx(36, rel=0.3)


def test_a_view_of_another_world_is_no_more_than_chance(world):
    poses, points = world
    posed = build_map(views(poses, points), poses, [CAMERA] * 6)
    (other,) = views(poses[:1], points, seed=1)
    strangers = replace(
        other, descriptors=posed.features[2].descriptors[: len(other)], points=other.points[: len(posed.features[2])]
    )
    found = posed.locate(strangers, range(6), CAMERA)
    assert len(found.points) > 100  # all of them wrong
    assert found.log10_false_alarms > -3


def test_a_thing_that_also_stands_elsewhere_agrees_with_a_pose_but_most_of_the_place_is_missing(world):
    poses, points = world
    mapped = views(poses, points)
    posed = build_map(mapped, poses, [CAMERA] * 6)
    here = posed.locate(mapped[2], range(6), CAMERA)
    near = np.linalg.norm(mapped[2].points - mapped[2].points.mean(0), axis=1).argsort()[:50]
    rng = np.random.default_rng(7)
    strange = rng.normal(size=mapped[2].descriptors.shape)
    strange /= np.linalg.norm(strange, axis=1, keepdims=True)
    strange[near] = mapped[2].descriptors[near]
    there = posed.locate(replace(mapped[2], descriptors=strange.astype(np.float16)), range(6), CAMERA)
    assert here.seen > 0.8
    assert there.pose.inliers.sum() >= 45
    assert there.seen < 0.3


def test_matches_that_contradict_the_poses_make_no_points(world):
    poses, points = world
    wrong = poses.copy()
    wrong[:, 1, 3] += np.linspace(0, 3, 6) ** 2
    assert len(build_map(views(poses, points), wrong, [CAMERA] * 6).points) < 60


def test_the_focal_length_of_a_map_follows_from_its_poses(world):
    poses, points = world
    turned = poses.copy()
    angle = np.linspace(-0.3, 0.3, 6)
    turned[:, 0, 0], turned[:, 0, 2], turned[:, 2, 0], turned[:, 2, 2] = (
        np.cos(angle),
        np.sin(angle),
        -np.sin(angle),
        np.cos(angle),
    )
    assert focal_length_of(views(turned, points), turned) * 640 == pytest.approx(520, rel=0.02)
    assert focal_length_of(views(turned, points[:5]), turned) is None


def test_features_match_both_ways_or_not_at_all():
    rng = np.random.default_rng(0)
    unit = rng.normal(size=(30, 64))
    unit = (unit / np.linalg.norm(unit, axis=1, keepdims=True)).astype(np.float16)
    points = rng.uniform(0, 100, (30, 2)).astype(np.float32)
    first = LocalFeatures(points, unit, 100, 100)
    order = rng.permutation(30)
    both = (np.concatenate([points, points[:1]]), np.concatenate([unit[order], unit[:1]]))
    second = LocalFeatures(*both, 100, 100)
    pairs = mutual_matches(first, second)
    assert len(pairs) == 30
    assert (order[pairs[pairs[:, 1] < 30, 1]] == pairs[pairs[:, 1] < 30, 0]).all()
    assert len(mutual_matches(first, replace(second, points=points[:0], descriptors=unit[:0]))) == 0
    assert len(mutual_matches(first, replace(second, descriptors=-second.descriptors))) < 5


def test_chance_explains_few_inliers_and_not_many():
    assert log_false_alarms(500, 3, 4, 640 * 480) == math.inf
    assert log_false_alarms(500, 6, 4, 640 * 480) > 0
    assert log_false_alarms(500, 60, 4, 640 * 480) < -50
    with pytest.raises(ArgumentError, match="inliers=6 must be at most matches=5"):
        log_false_alarms(5, 6, 4, 640 * 480)
    with pytest.raises(ArgumentError, match="radius_px=0 must be above 0"):
        log_false_alarms(500, 6, 0, 640 * 480)


def line(n, rng):
    """Poses along a line that look to its side, and points there."""
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = np.linspace(0, 3, n)
    poses[:, 1, 3] = rng.uniform(-0.3, 0.3, n)
    points = np.column_stack([rng.uniform(-2, 5, 250), rng.uniform(-2, 2, 250), rng.uniform(4, 9, 250)])
    return poses, points


@pytest.mark.slow
@pytest.mark.parametrize(("metres", "degrees"), [(0.0, 0.0), (0.01, 0.0), (0.01, 0.05)])
def test_regions_in_a_map_hold_the_truth_whether_or_not_its_poses_are_exact(metres, degrees):
    """95 % regions of 48 views, 42 or more: 0.98 by the binomial distribution; given poses err at random."""
    held, plain = [], []
    for seed in range(12):  # of 16 images each
        rng = np.random.default_rng(seed)
        poses, points = line(16, rng)
        features = views(poses, points, seed=seed)
        told = poses.copy()
        told[:, :3, 3] += rng.normal(scale=metres, size=(16, 3))
        turns = Rotation.from_rotvec(rng.normal(scale=np.deg2rad(degrees), size=(16, 3)))
        told[:, :3, :3] = told[:, :3, :3] @ turns.as_matrix()
        queries = np.arange(16) % 4 == 2
        rest = np.flatnonzero(~queries)
        posed = calibrated(build_map([features[k] for k in rest], told[rest], [CAMERA] * len(rest)))
        for k in np.flatnonzero(queries):
            near = np.argsort(np.abs(rest - k))[:8].tolist()
            found = posed.locate(features[k], near, CAMERA)
            squared = squared_error(found.pose, told[k])
            held.append(squared < stats.chi2.ppf(0.95, 6))
            bare = replace(posed, errors=PoseErrors()).locate(features[k], near, CAMERA)
            plain.append(squared_error(bare.pose, told[k]) < stats.chi2.ppf(0.95, 6))
    assert np.sum(held) >= 42
    if metres:
        assert np.mean(plain) < np.mean(held) - 0.3  # without what the map knows of its poses


def test_points_without_an_image_are_those_of_the_others(world):
    poses, points = world
    features = views(poses, points)
    posed = build_map(features, poses, [CAMERA] * 6)
    rest, candidates = without(posed, 3)
    assert 3 not in candidates
    assert (rest.point_of[3] < 0).all() or (rest.point_of[3][rest.point_of[3] >= 0] < len(posed.points)).all()
    others = build_map([features[k] for k in (0, 1, 2, 4, 5)], poses[[0, 1, 2, 4, 5]], [CAMERA] * 5)
    mine = rest.points[rest.point_of[2][rest.point_of[2] >= 0]]
    theirs = others.points[others.point_of[2][others.point_of[2] >= 0]]
    apart = np.linalg.norm(mine[:, None] - theirs[None], axis=2).min(1)
    assert np.quantile(apart, 0.95) < 1e-6


def test_an_image_that_shares_no_point_is_left_out_of_none(world):
    poses, points = world
    blank = LocalFeatures(np.empty((0, 2), np.float32), np.empty((0, 64), np.float16), 640, 480)
    posed = build_map([*views(poses, points), blank], np.concatenate([poses, poses[:1]]), [CAMERA] * 7)
    rest, candidates = without(posed, 6)
    assert candidates == []
    assert len(rest.points) == len(posed.points)
    assert calibrated(posed).errors.scale >= 1


def test_a_map_of_few_images_knows_no_errors(world):
    poses, points = world
    assert calibrated(build_map(views(poses[:3], points), poses[:3], [CAMERA] * 3)).errors == PoseErrors()


def test_neighbours_of_a_large_map_are_the_nearest_that_look_the_same_way():
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (300, 1, 1))
    poses[:, :3, 3] = rng.uniform(0, 50, (300, 3))
    poses[::2, :3, :3] = np.diag([-1.0, 1.0, -1.0])
    pairs = neighbouring(poses)
    position = poses[:, :3, 3]
    for i in (0, 17, 205):
        distance = np.linalg.norm(position - position[i], axis=1)
        same = [j for j in np.argsort(distance) if j != i and (i - j) % 2 == 0][:8]
        assert {(min(i, j), max(i, j)) for j in same} <= set(pairs)
    assert all((i - j) % 2 == 0 for i, j in pairs)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (lambda poses: poses @ np.diag([1.0, -1.0, -1.0, 1.0]), "OpenGL"),
        (np.linalg.inv, "camera_from_world"),
        (lambda poses: poses, None),
    ],
)
def test_poses_of_another_convention_are_named(world, changed, named):
    poses, points = world
    turned = poses.copy()
    for pose, angle in zip(turned, np.linspace(-0.3, 0.3, 6), strict=True):
        pose[:3, :3] = Rotation.from_euler("yx", [angle, angle / 2]).as_matrix()
    found = likely_convention(views(turned, points), changed(turned), [CAMERA] * 6)
    assert (found is None) if named is None else (named in found)


def test_contradicting_poses_name_no_convention(world):
    poses, points = world
    rng = np.random.default_rng(0)
    wrong = poses.copy()
    wrong[:, :3, 3] = rng.normal(size=(6, 3))
    wrong[:, :3, :3] = Rotation.from_rotvec(rng.normal(scale=0.2, size=(6, 3))).as_matrix()
    assert likely_convention(views(poses, points), wrong, [CAMERA] * 6) is None
