"""Drives and the motions between their frames."""

import math

import numpy as np
import pytest
from data.localization.drives import circle, numbers
from hypothesis import given
from hypothesis import strategies as st

from sextant.chapters.localization.data import Drive, LocalizationData
from sextant.chapters.localization.data.drive import between, compose, compose_over, first_share, motions_along
from sextant.chapters.localization.data.simulated import (
    CAR_WHEELS,
    FRAME_SIGMA,
    simulated_motion,
    simulated_railway_motion,
)
from sextant.worlds.odometry import drift


def dead_reckoning(start, motion):
    """Poses from the first on, one multiplication of matrices after the other."""

    def matrix(x, y, turn):
        return np.array([[math.cos(turn), -math.sin(turn), x], [math.sin(turn), math.cos(turn), y], [0, 0, 1]])

    pose = matrix(*start)
    poses = [pose]
    for step in motion[1:]:
        pose = pose @ matrix(*step)
        poses.append(pose)
    return np.array([(p[0, 2], p[1, 2], math.atan2(p[1, 0], p[0, 0])) for p in poses])


def random_poses(seed, n=30):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.normal(0, 50, (n, 2)), rng.uniform(-np.pi, np.pi, n)])


def same_poses(a, b, tolerance=1e-9):
    turn = (a[:, 2] - b[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return np.abs(a[:, :2] - b[:, :2]).max() < tolerance and np.abs(turn).max() < tolerance


@given(st.integers(0, 1000))
def test_motions_lead_from_pose_to_pose(seed):
    poses = random_poses(seed)
    motion = motions_along(poses)
    assert (motion[0] == 0).all()
    assert same_poses(dead_reckoning(poses[0], motion), poses)
    assert same_poses(compose(poses[:-1], motion[1:]), poses[1:])
    assert same_poses(compose(poses, between(poses, poses[::-1])), poses[::-1])


@given(st.integers(0, 1000), st.integers(1, 7), st.integers(0, 12))
def test_a_selected_drive_dead_reckons_to_the_same_poses(seed, step, start):
    poses = random_poses(seed)
    told = motions_along(random_poses(seed + 1))  # odometry knows nothing of the truth
    drive = Drive.of("d", "day", poses, motion=told).select(start, None, step)
    rows = np.arange(start, 30, step)
    assert np.array_equal(drive.poses, poses[rows])
    assert np.array_equal(drive.frames, rows)
    odometry = dead_reckoning((0, 0, 0), told)
    assert same_poses(dead_reckoning(odometry[start], drive.motion), odometry[rows], 1e-7)
    uneven = np.unique(np.random.default_rng(seed).integers(0, 30, 9))
    assert same_poses(dead_reckoning(odometry[uneven[0]], compose_over(told, uneven)), odometry[uneven], 1e-7)


def test_motion_over_a_missing_step_is_missing():
    drive = circle(12)
    drive.motion[5] = np.nan
    assert np.isnan(drive.select(0, None, 4).motion[:, 0]).tolist() == [False, False, True]
    assert np.isnan(drive.select(5).motion).sum() == 0  # how it came to its first frame does not matter


def test_select_takes_pictures_scans_times_and_kidnaps_along():
    drive = circle(20, times_s=np.arange(20) / 2.0)
    drive = Drive(**{**vars(drive), "kidnaps": (3, 7, 8, 19), "seen": np.arange(20) != 6})
    part = drive.select(3, 18, 3)
    assert numbers(part).tolist() == [3, 6, 9, 12, 15] == part.laser[:, 0].tolist() == part.frames.tolist()
    assert part.times_s.tolist() == [1.5, 3.0, 4.5, 6.0, 7.5]
    assert part.seen.tolist() == [True, False, True, True, True]
    assert part.kidnaps == (2,)  # at 7 and 8, between 6 and 9; at 3 the drive begins, and 19 is beyond its end
    assert part.renumbered().frames.tolist() == [0, 1, 2, 3, 4]
    whole = drive.select()
    assert whole.kidnaps == drive.kidnaps
    assert np.array_equal(whole.motion, drive.motion)


def test_taken_frames_have_no_motion_and_no_times_out_of_order():
    drive = circle(10, times_s=np.arange(10.0))
    back = drive.take(np.array([4, 2, 2]))
    assert numbers(back).tolist() == [4, 2, 2]
    assert back.motion is None
    assert back.times_s is None
    assert drive.take(np.array([2, 4])).times_s.tolist() == [2, 4]


@pytest.mark.parametrize(
    "wrong", [{"images": circle(9).images}, {"poses": np.full((10, 3), np.nan)}, {"kidnaps": (0,)}, {"kidnaps": (10,)}]
)
def test_a_drive_refuses_what_makes_no_sense(wrong):
    with pytest.raises(ValueError, match=r"lengths|finite|kidnaps"):
        Drive(**{**vars(circle(10)), **wrong})
    for step, start in ((0, 0), (1, 10)):
        with pytest.raises(ValueError, match=r"step|frame"):
            circle(10).select(start, None, step)


@given(st.integers(2, 50), st.floats(0.01, 0.99))
def test_validation_and_test_share_no_frame(n, share):
    (early,), (late,) = first_share([circle(n)], share)
    assert [*numbers(early), *numbers(late)] == list(range(n))
    assert abs(len(early) - share * n) <= 1
    assert late.frames.tolist() == list(range(len(late)))
    assert early.name != late.name
    assert (late.motion[0] == 0).all()


def test_drives_of_one_dataset_have_names_of_their_own():
    with pytest.raises(ValueError, match="distinct names"):
        LocalizationData(circle(), (circle(), circle()), (), None, "m", "town")


# -- simulated odometry ------------------------------------------------------------------------------------------------


def test_a_car_errs_as_it_is_said_to():
    straight = np.column_stack([np.arange(0.0, 3000.0, 3.0), np.zeros((1000, 2))])
    runs = [simulated_motion(straight, CAR_WHEELS, 1.0, seed, "d") for seed in range(20)]
    odometry = [dead_reckoning((0, 0, 0), motion) for motion in runs]
    moved, turned = np.array([drift(straight, told, 99.0) for told in odometry]).T
    # over 99 m: 1 % and 0.15 m sqrt(9.9) ahead; sideways, the heading's walk of 0.5 degrees sqrt(9.9), integrated
    sigma = np.radians(0.5) * np.sqrt(9.9)
    ahead, aside = np.hypot(0.99, 0.15 * np.sqrt(9.9)), 99 * np.hypot(sigma / np.sqrt(3), 99 * np.radians(0.01) / 2)
    assert np.sqrt((moved**2).mean()) == pytest.approx(np.hypot(ahead, aside), rel=0.15)
    assert np.sqrt((turned**2).mean()) == pytest.approx(np.hypot(sigma, 99 * np.radians(0.01)), rel=0.15)
    assert np.array_equal(runs[0], simulated_motion(straight, CAR_WHEELS, 1.0, 0, "d"))
    assert not np.array_equal(runs[0], simulated_motion(straight, CAR_WHEELS, 1.0, 0, "e"))
    assert same_poses(simulated_motion(straight, CAR_WHEELS, 0.0, 0, "d"), motions_along(straight))


def test_a_train_counts_its_frames_with_an_error_of_a_tenth():
    frames = np.arange(100.0, 20100.0)
    motion = simulated_railway_motion(frames, 1.0, 0, "d")
    assert (motion[0] == 0).all()
    assert (motion[:, 1:] == 0).all()
    assert motion[1:, 0].mean() == pytest.approx(1.0, abs=4 * FRAME_SIGMA / np.sqrt(20000))
    assert motion[1:, 0].std() == pytest.approx(FRAME_SIGMA, rel=0.03)
    far = simulated_railway_motion(4 * frames, 1.0, 0, "d")
    assert far[1:, 0].std() == pytest.approx(2 * FRAME_SIGMA, rel=0.03)
    assert np.array_equal(
        simulated_railway_motion(frames, 0.0, 0, "d"), motions_along(np.pad(frames[:, None], ((0, 0), (0, 2))))
    )
