"""Errors of trajectories: properties, small examples, and the tool evo where it is installed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sextant.errors import ArgumentError
from sextant.evaluation.trajectory_error import (
    SEGMENTS_M,
    ErrorStatistics,
    absolute_errors,
    pooled_errors,
    relative_errors,
    segment_errors,
)

STATISTICS = ("rmse", "mean", "median", "std", "min", "max", "sse")


def curve(seed, frames=200):
    """A planar drive and a drifting estimate of it."""
    rng = np.random.default_rng(seed)
    turn, step = rng.normal(0, 0.05, frames), np.abs(rng.normal(1, 0.3, frames))
    step[40:45] = 0.0  # it stands
    drives = []
    for drift, scale in ((0.0, 1.0), (0.002, 1.03)):
        heading = np.cumsum(turn + drift)
        ways = scale * step[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        drives.append(np.column_stack([np.cumsum(ways, axis=0), heading]))
    return drives


def in_space(poses, seed=0, jitter=0.0):
    """The same as 4x4 matrices, on ground that is not level."""
    rng = np.random.default_rng(seed)
    out = np.tile(np.eye(4), (len(poses), 1, 1))
    angles = np.column_stack([poses[:, 2], rng.normal(0, 0.02, (len(poses), 2))])
    out[:, :3, :3] = Rotation.from_euler("ZYX", angles).as_matrix()
    out[:, :3, 3] = np.column_stack([poses[:, :2], np.sin(poses[:, 0] / 9)]) + jitter * rng.normal(size=(len(poses), 3))
    return out


def moved(poses, x, y, turn, scale=1.0):
    c, s = np.cos(turn), np.sin(turn)
    placed = scale * poses[:, :2] @ np.array([[c, s], [-s, c]]) + [x, y]
    return np.column_stack([placed, poses[:, 2] + turn])


MOTIONS = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-4, 4))


@pytest.mark.slow
@given(MOTIONS, st.integers(0, 9))
def test_a_rigid_motion_is_aligned_away_and_a_similarity_is_not(motion, seed):
    truth, _ = curve(seed)
    for part in ("translation", "rotation_deg"):
        np.testing.assert_allclose(
            absolute_errors(truth, moved(truth, *motion), alignment="rigid", part=part), 0, atol=1e-6
        )
    scaled = moved(truth, *motion, scale=1.7)
    np.testing.assert_allclose(absolute_errors(truth, scaled, alignment="similarity"), 0, atol=1e-6)
    assert absolute_errors(truth, scaled, alignment="rigid").max() > 1


@given(MOTIONS, st.integers(0, 9))
def test_relative_errors_do_not_see_where_the_estimate_starts(motion, seed):
    truth, guess = curve(seed)
    for part in ("translation", "rotation_deg"):
        errors = relative_errors(truth, guess, delta=10, part=part)
        again = relative_errors(truth, moved(guess, *motion), delta=10, part=part)
        np.testing.assert_allclose(errors, again, atol=1e-6)


@pytest.mark.slow
@given(st.integers(0, 99))
def test_alignment_is_the_least_squares_one(seed):
    truth, guess = curve(seed)
    best = (absolute_errors(truth, guess, alignment="rigid") ** 2).sum()
    rng = np.random.default_rng(seed)
    from scipy.optimize import minimize

    def cost(motion):
        return (absolute_errors(truth, moved(guess, *motion)) ** 2).sum()

    found = min(minimize(cost, rng.normal(0, 1, 3), method="BFGS").fun for _ in range(2))
    assert best <= found * (1 + 1e-9)
    assert best == pytest.approx(found, rel=1e-3)


def test_a_corner_by_hand():
    truth = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, np.pi / 2], [2, 1, np.pi / 2]])
    guess = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1, np.pi], [1, 1, np.pi]])
    assert absolute_errors(truth, guess).tolist() == [0, 0, 1, 1]
    np.testing.assert_allclose(absolute_errors(truth, guess, part="rotation_deg"), [0, 0, 90, 90])
    np.testing.assert_allclose(relative_errors(truth, guess), [0, 1, 0], atol=1e-12)  # one wrong turn, one error
    np.testing.assert_allclose(relative_errors(truth, guess, part="rotation_deg"), [0, 90, 0], atol=1e-6)


def test_each_pair_starts_where_the_last_one_ended():
    truth = np.column_stack([np.arange(7.0), np.zeros((7, 2))])
    assert [len(relative_errors(truth, truth, delta=d)) for d in (1, 2, 3, 6, 7)] == [6, 3, 2, 1, 0]


def test_the_plane_is_a_part_of_space():
    truth, guess = curve(3)

    def lifted(poses):
        out = np.tile(np.eye(4), (len(poses), 1, 1))
        out[:, :3, :3] = Rotation.from_rotvec(poses[:, 2:] * [0, 0, 1]).as_matrix()
        out[:, :2, 3] = poses[:, :2]
        return out

    for alignment in ("none", "rigid", "similarity"):
        for part in ("translation", "rotation_deg"):
            flat = absolute_errors(truth, guess, alignment=alignment, part=part)
            high = absolute_errors(lifted(truth), lifted(guess), alignment=alignment, part=part)
            np.testing.assert_allclose(flat, high, atol=1e-5)
    np.testing.assert_allclose(
        relative_errors(truth, guess, delta=5), relative_errors(lifted(truth), lifted(guess), delta=5)
    )


def test_statistics_are_what_their_names_say():
    found = ErrorStatistics.of(np.array([3.0, 4.0]))
    assert (found.rmse, found.mean, found.median, found.std, found.min, found.max, found.sse) == (
        pytest.approx(np.sqrt(12.5)), 3.5, 3.5, 0.5, 3, 4, 25,
    )  # fmt: skip


def test_a_pose_that_is_not_finite_cannot_be_aligned():
    truth = np.random.default_rng(0).normal(size=(6, 3))
    guess = truth.copy()
    guess[4, 1] = np.nan
    for reference, estimate, name in ((truth, guess, "estimate"), (guess, truth, "reference")):
        with pytest.raises(ArgumentError, match=f"{name}: pose 4, counted from 0, is not finite"):
            absolute_errors(reference, estimate, alignment="rigid")


def test_what_cannot_be_compared_is_refused():
    truth, guess = curve(0)
    with pytest.raises(ValueError, match="same frames"):
        absolute_errors(truth, guess[:-1])
    with pytest.raises(ValueError, match="they lie in a point"):
        absolute_errors(truth * 0, guess * 0, alignment="rigid")
    for delta, told in ((0, "at least 1"), (-1, "at least 1"), (1.5, "a whole number"), (np.inf, "a whole number")):
        with pytest.raises(ArgumentError, match=f"delta={delta} must be {told}"):
            relative_errors(truth, guess, delta=delta)
    with pytest.raises(ValueError, match="no pair of poses at this distance"):
        ErrorStatistics.of(relative_errors(truth, guess, delta=200))


def compare_with_evo(truth, guess, tolerance):
    """Every statistic of both errors, in evo's way and in ours."""
    metrics = pytest.importorskip("evo.core.metrics")
    trajectory = pytest.importorskip("evo.core.trajectory")
    reference = trajectory.PosePath3D(poses_se3=list(truth))
    relation = {
        "translation": metrics.PoseRelation.translation_part,
        "rotation_deg": metrics.PoseRelation.rotation_angle_deg,
    }

    def same(errors, peer):
        assert len(errors) == len(peer.error)
        np.testing.assert_allclose(errors, peer.error, atol=tolerance, rtol=tolerance)
        ours, theirs = ErrorStatistics.of(errors), peer.get_all_statistics()
        for name in STATISTICS:
            assert getattr(ours, name) == pytest.approx(theirs[name], rel=tolerance, abs=tolerance), name

    for alignment in ("none", "rigid", "similarity"):
        estimate = trajectory.PosePath3D(poses_se3=[pose.copy() for pose in guess])
        if alignment != "none":
            estimate.align(reference, correct_scale=alignment == "similarity")
        for part, name in relation.items():
            peer = metrics.APE(name)
            peer.process_data((reference, estimate))
            same(absolute_errors(truth, guess, alignment=alignment, part=part), peer)
    estimate = trajectory.PosePath3D(poses_se3=list(guess))
    for delta in (1, 10):
        for part, name in relation.items():
            peer = metrics.RPE(name, delta, metrics.Unit.frames)
            peer.process_data((reference, estimate))
            same(relative_errors(truth, guess, delta=delta, part=part), peer)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_made_up_drives_have_the_errors_that_evo_finds(seed):
    truth, guess = curve(seed)
    compare_with_evo(in_space(truth), in_space(guess, 1, jitter=0.05), 1e-9)


@pytest.mark.real_data
@pytest.mark.slow
def test_a_real_drive_has_the_errors_that_evo_finds(real_data):
    """Visual odometry (ORB-SLAM) on the first drive of KITTI: 1500 of its 4541 poses."""
    drives = []
    for file in ("poses/00.txt", "estimates/00_ORB.txt"):
        rows = np.loadtxt(real_data / "kitti" / file).reshape(-1, 3, 4)[:1500]
        drives.append(np.concatenate([rows, np.broadcast_to([[[0.0, 0, 0, 1]]], (len(rows), 1, 4))], axis=1))
    compare_with_evo(*drives, 1e-9)


@pytest.mark.parametrize(
    ("errors", "unknown", "told"),
    [
        (absolute_errors, {"alignment": "sim3"}, "alignment=.sim3. must be one of none, rigid, similarity"),
        (absolute_errors, {"part": "rotation"}, "part=.rotation. must be one of translation, rotation_deg"),
        (relative_errors, {"part": "rotation"}, "part=.rotation. must be one of"),
    ],
)
def test_unknown_words_are_refused(errors, unknown, told):
    truth, guess = curve(0)
    with pytest.raises(ArgumentError, match=told):
        errors(truth, guess, **unknown)


def test_errors_of_several_runs_are_pooled_over_a_span_of_each():
    truth, guess = curve(3)
    reference, estimate = np.stack([truth, truth], axis=1), np.stack([guess, moved(truth, 5, -2, 0.4)], axis=1)
    aligned, step, step_deg = pooled_errors(reference, estimate, [(10, 60), (20, 200)])
    np.testing.assert_allclose(aligned[:50], absolute_errors(truth[10:60], guess[10:60], alignment="rigid"))
    np.testing.assert_allclose(aligned[50:], 0, atol=1e-6)
    assert len(aligned) == 50 + 180
    np.testing.assert_allclose(step[:49], relative_errors(truth[10:60], guess[10:60]))
    np.testing.assert_allclose(step_deg[:49], np.degrees(0.002), rtol=1e-6)
    assert len(step) == len(step_deg) == 49 + 179


@pytest.mark.parametrize("span", [(0, 0), (40, 41), (39, 45)])
def test_runs_that_do_not_move_or_never_converged_are_not_aligned(span):
    truth, _ = curve(0)
    poses = truth[:, None]
    guess = np.where(np.isin(np.arange(200), range(*span))[:, None, None], poses, 9e9)
    aligned, step, _ = pooled_errors(poses, guess, [span])
    assert aligned.size == 0
    assert len(step) == max(span[1] - span[0] - 1, 0)


@pytest.mark.parametrize("which", [0, 1])
def test_a_position_that_is_not_finite_is_not_taken_for_standing_still(which):
    poses = [np.random.default_rng(0).normal(size=(5, 1, 3)) for _ in range(2)]
    poses[which][2, 0, 0] = np.nan
    with pytest.raises(ArgumentError, match=f"{('reference', 'estimate')[which]}: pose 2"):
        pooled_errors(*poses, [(0, 5)])


def test_segments_are_those_of_the_definition():
    """KITTI's errors, written as the benchmark defines them: one start and one length at a time."""
    rng = np.random.default_rng(3)
    truth = drive_in_space(rng, 700)
    guess = drive_in_space(rng, 700)
    expected = []
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])
    for first in range(0, 700, 10):
        for length in SEGMENTS_M:
            later = [i for i in range(first, 700) if way[i] > way[first] + length]
            if not later:
                continue
            moved = np.linalg.inv(truth[first]) @ truth[later[0]]
            guessed = np.linalg.inv(guess[first]) @ guess[later[0]]
            error = np.linalg.inv(guessed) @ moved
            cosine = np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)
            expected.append((np.linalg.norm(error[:3, 3]) / length, np.degrees(np.arccos(cosine)) / length))
    shares, turns = segment_errors(truth, guess)
    assert len(expected) > 200
    np.testing.assert_allclose(np.sort(shares), np.sort([share for share, _ in expected]), rtol=1e-9)
    np.testing.assert_allclose(np.sort(turns), np.sort([turn for _, turn in expected]), atol=1e-6)


def drive_in_space(rng, count):
    poses = np.tile(np.eye(4), (count, 1, 1))
    for i in range(1, count):
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.02, 3)).as_matrix()
        step[:3, 3] = rng.uniform(0.5, 1.5), 0, 0
        poses[i] = poses[i - 1] @ step
    return poses
