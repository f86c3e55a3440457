"""The focal length that photos of one camera share: made-up scenes, whose truth is known, and photos."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("poselib")
from sextant.correspondence import (
    LocalFeatures,
    Pinhole,
    XFeatures,
    distinct_matches,
    shared_focal,
    shared_focal_length,
)
from sextant.correspondence.bundle import Scene, Tracks, _slopes, errors, fitted
from sextant.correspondence.turned_camera import turns_of
from sextant.errors import ArgumentError

CAMERA = Pinhole.centred(640, 480, 520.0)


def photos(rng, poses, points, camera=CAMERA, noise=0.4, descriptors=None):
    """Features of points from camera_from_world poses; each point keeps its descriptor."""
    unit = np.linalg.qr(rng.normal(size=(len(points), len(points))))[0] if descriptors is None else descriptors
    found = []
    for turn, way in poses:
        inside = points @ turn.T + way
        pixels = camera.project(inside) + rng.normal(scale=noise, size=(len(points), 2))
        seen = np.isfinite(pixels).all(1) & (pixels > 0).all(1) & (pixels < [camera.width, camera.height]).all(1)
        found.append(LocalFeatures(pixels[seen].astype(np.float32), unit[seen].astype(np.float16), 640, 480))
    return found


def around(count, step=0.18, nearer=0.4):
    """Cameras that look at a point 6 m away, each from elsewhere and nearer than the one before."""
    poses = []
    for k in range(count):
        turn = Rotation.from_euler("yx", [step * k, 0.07 * (-1) ** k]).as_matrix()
        poses.append((turn, np.array([0.1 * k, 0.0, 6.0 - nearer * k])))
    return poses


def points(rng, count=400, depth=2.0):
    return np.column_stack(
        [rng.uniform(-2.5, 2.5, count), rng.uniform(-1.8, 1.8, count), rng.uniform(-depth, depth, count)]
    )


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4])
def test_the_focal_length_is_found_within_its_interval(count):
    """Truth inside the 95 % interval in at least 8 of 10 scenes: 0.99 by the binomial distribution."""
    held, error = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        found = shared_focal_length(photos(rng, around(count), points(rng)))
        held.append(found.interval_px[0] <= 520 <= found.interval_px[1])
        error.append(abs(found.focal_px / 520 - 1))
        assert found.verdict in ("unchecked" if count == 2 else "known", "undetermined")
    assert sum(held) >= 8
    assert np.nanmedian(error) < (0.03 if count == 2 else 0.01)


def test_cameras_that_do_not_determine_it_are_told():
    rng = np.random.default_rng(0)
    fixating = [(Rotation.from_euler("y", angle).as_matrix(), np.array([0.0, 0.0, 6.0])) for angle in (-0.1, 0.1)]
    flat = points(rng, depth=0.0)
    for poses, seen in ((fixating, points(rng)), (around(2), flat)):
        found = shared_focal_length(photos(rng, poses, seen))
        assert found.verdict == "undetermined" or found.focal_sigma > 0.05
        assert found.interval_px[0] < 520 < found.interval_px[1]


@pytest.mark.slow
def test_a_camera_that_only_turns_tells_it_by_the_turns():
    held = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        turns = [(Rotation.from_euler("yx", [0.15 * k, 0.1 * (k % 2)]).as_matrix(), np.zeros(3)) for k in range(3)]
        found = shared_focal_length(photos(rng, turns, points(rng) * [1, 1, 0.5] + [0.5, 0, 6]))
        assert (found.verdict, found.turned) == ("known", True)
        assert found.focal_px == pytest.approx(520, rel=0.03)
        held.append(found.interval_px[0] < 520 < found.interval_px[1])
    assert sum(held) >= 5


@pytest.mark.parametrize("angles", [[0, 0, 0], [0, 0, 10]])
@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_a_camera_that_did_not_turn_or_only_about_its_axis_tells_nothing(angles, noise):
    rng = np.random.default_rng(0)
    turns = [
        (Rotation.from_euler("xyz", np.multiply(angles, k), degrees=True).as_matrix(), np.zeros(3)) for k in (0, 1)
    ]
    found = shared_focal_length(photos(rng, turns, points(rng) * [1, 1, 0.5] + [0, 0, 6], noise=noise))
    assert (found.verdict, found.focal_sigma) == ("undetermined", None)
    assert found.interval_px[0] < 400 < 1500 < found.interval_px[1]


def test_matches_too_few_to_judge_turns_by_are_judged_by_poses(monkeypatch):
    monkeypatch.setattr(shared_focal, "MATCHES", 25)
    rng = np.random.default_rng(0)
    found = shared_focal_length(photos(rng, around(2), points(rng), noise=0.0))
    assert (found.verdict, found.turned) in {("unchecked", False), ("undetermined", False)}


@pytest.mark.parametrize("wrong", [None, ["a.jpg", "b.jpg"], "ab"])
def test_what_is_no_list_of_features_is_refused(wrong):
    with pytest.raises(ArgumentError, match="must be a list of local features"):
        shared_focal_length(wrong)


@pytest.mark.slow
def test_small_turns_tell_it_without_a_bias():
    """Errors shrink with a photo whose distortion is negative, which must not favour one."""
    ratios = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        turns = [
            (Rotation.from_euler("yx", turn, degrees=True).as_matrix(), np.zeros(3))
            for turn in ((0, 0), (1, 0), (0, 1))
        ]
        found = shared_focal_length(photos(rng, turns, points(rng, 600) * [1, 1, 0.5] + [0, 0, 5]))
        assert found.interval_px[0] < 520 < found.interval_px[1]
        ratios.append(found.focal_px / 520)
    assert np.mean(ratios) == pytest.approx(1, abs=0.03)


def with_something_that_moves(rng, count, moving):
    """Photos of still points, and of ``moving`` points that turn and rise."""
    unit = np.linalg.qr(rng.normal(size=(600, 600)))[0]
    poses, still, thing = around(count), points(rng), points(rng, moving) * 0.4 + [0.5, 0, -1]
    views = photos(rng, poses, still, descriptors=unit[:400])
    for k, pose in enumerate(poses):
        turn = Rotation.from_euler("xy", [0.1 * k, -0.15 * k]).as_matrix()
        moved = thing @ turn.T + [-0.3 * k, 0.25 * k, 0.2 * k]
        (more,) = photos(rng, [pose], moved, descriptors=unit[400 : 400 + moving])
        both = (
            np.concatenate(each) for each in zip(*((f.points, f.descriptors) for f in (views[k], more)), strict=True)
        )
        views[k] = LocalFeatures(*both, 640, 480)
    return views


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize(("moving", "told"), [(120, True), (12, False)])
def test_a_scene_that_moves_is_told_and_little_that_moves_has_no_say(count, moving, told):
    found = shared_focal_length(with_something_that_moves(np.random.default_rng(count), count, moving))
    assert (found.verdict == "moving scene") == told
    if told:
        assert (found.focal_sigma, found.interval_px) == (None, (0.0, np.inf))
    else:
        assert found.focal_px == pytest.approx(520, rel=0.06)


def test_photos_of_other_scenes_have_none():
    rng = np.random.default_rng(0)
    one, other = (photos(rng, around(1), points(rng, 100))[0] for _ in range(2))
    found = shared_focal_length([one, other])
    assert (found.verdict, found.focal_sigma) == ("no common scene", None)


def test_photos_that_cannot_share_it_are_refused():
    empty = [
        LocalFeatures(np.empty((0, 2), np.float32), np.empty((0, 8), np.float16), *size)
        for size in ((640, 480), (320, 240))
    ]
    with pytest.raises(ArgumentError, match="640x480 pixels have no focal length in pixels in common"):
        shared_focal_length(empty)
    with pytest.raises(ArgumentError, match="1 photo; a shared focal length needs 2 to 10"):
        shared_focal_length(empty[:1])


def test_pixels_of_turns_that_differ_in_number_are_refused():
    with pytest.raises(ArgumentError, match=r"second has the shape \(10, 2\), but must have \(5000, 2\)"):
        turns_of({(0, 1): (np.zeros((5000, 2)), np.zeros((10, 2)))}, np.array([500.0]))


def test_repeated_features_are_no_distinct_matches():
    rng = np.random.default_rng(0)
    unit = np.linalg.qr(rng.normal(size=(64, 64)))[0].astype(np.float16)
    one = LocalFeatures(rng.uniform(0, 400, (64, 2)).astype(np.float32), unit, 640, 480)
    twice = LocalFeatures(np.tile(one.points, (2, 1)), np.concatenate([unit, unit[:10] * 1.0, unit[10:]]), 640, 480)
    twice = LocalFeatures(twice.points[:74], twice.descriptors[:74], 640, 480)
    assert len(distinct_matches(one, one)) == 64
    assert set(distinct_matches(one, twice)[:, 0].tolist()) == set(range(10, 64))


def test_an_adjusted_scene_has_the_slope_of_its_valley():
    """A fit at a nearby focal length, started along the slope, begins near its end."""
    rng = np.random.default_rng(1)
    world, poses = points(rng, 80), around(3)
    turns, ways = (np.stack(each) for each in zip(*poses, strict=True))
    pixels = np.concatenate([CAMERA.project(world @ turn.T + way) - [319.5, 239.5] for turn, way in poses])
    order = np.argsort(np.tile(np.arange(80), 3), kind="stable")
    tracks = Tracks(
        pixels[order], np.repeat(np.arange(3), 80)[order], np.repeat(np.arange(80), 3), np.zeros(3, int), 640.0
    )
    scene = Scene(np.array([np.log(520.0), 0, 0, 0]), turns, ways, world)
    assert np.abs(errors(tracks, scene)).max() < 1e-9
    tilted = Scene(scene.shared + np.array([0.05, 0, 0, 0]), turns, ways, world + 0.02)
    found = fitted(tracks, tilted, 0.25, free=True)
    assert found.log_focal == pytest.approx(np.log(520.0), abs=2e-3)
    nearby = fitted(tracks, found.towards(found.log_focal + 0.5 * found.log_sigma), 0.25, free=False)
    assert nearby.deviation == pytest.approx(found.deviation + 0.25, abs=0.1)


def test_the_slopes_of_errors_are_right():
    """By differences, where a lens is distorted and points have errors."""
    rng, step = np.random.default_rng(0), 1e-6
    world, poses = points(rng, 12), around(2)
    turns, ways = (np.stack(each) for each in zip(*poses, strict=True))
    pixels = np.concatenate([CAMERA.project(world @ turn.T + way) - [319.5, 239.5] for turn, way in poses])
    tracks = Tracks(
        (pixels + rng.normal(0, 1, pixels.shape)).reshape(2, 12, 2).swapaxes(0, 1).reshape(-1, 2),
        np.tile([0, 1], 12), np.repeat(np.arange(12), 2), np.zeros(2, int), 640.0,
    )  # fmt: skip
    scene, still = Scene(np.array([np.log(500.0), -0.1, 3.0, -5.0]), turns, ways, world), np.zeros_like(world)
    slopes = _slopes(tracks, scene, errors(tracks, scene))[0]
    for k, way in enumerate(step * np.eye(slopes.shape[2])):
        apart = errors(tracks, scene.moved(way, still)) - errors(tracks, scene.moved(-way, still))
        assert slopes[:, :, k] == pytest.approx(apart / (2 * step), rel=1e-5, abs=1e-5)


@pytest.mark.slow
@pytest.mark.real_data
def test_five_photos_tell_the_focal_length_of_their_camera(real_data):
    from sextant.applications.pixels import as_pixels

    files = [real_data / "strecha_posed" / f"fountain-P11__{k:04d}.jpg" for k in range(5)]
    features = XFeatures(2048, 768).detect([as_pixels(file) for file in files])
    found = shared_focal_length(features)
    assert found.verdict == "known"
    assert found.focal_px == pytest.approx(1034.8, rel=0.02)
    assert found.interval_px[0] < 1034.8 < found.interval_px[1]


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize(("other", "verdict"), [("fountain-P11", "known"), ("castle-P30", "moving scene")])
def test_two_real_things_that_move_apart_are_told(real_data, other, verdict):
    """The left halves of three photos, beside the right halves of the same or of another place."""
    from sextant.applications.pixels import as_pixels

    named = [real_data / "strecha_posed" / f"{name}__{{:04d}}.jpg" for name in ("fountain-P11", other)]
    images = []
    for k in range(3):
        left, right = (as_pixels(str(name).format(k + 1)) for name in named)
        half = left.shape[1] // 2
        images.append(np.concatenate([left[:, :half], right[: len(left), half:]], 1))
    assert shared_focal_length(XFeatures(2048, 768).detect(images)).verdict == verdict
