"""Faults: what they change, what they leave alone, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from data.localization.drives import circle, numbers
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from sextant.chapters.localization.config import Fault as FaultSchema
from sextant.chapters.localization.data import LocalizationData, faults
from sextant.chapters.localization.data.drive import motions_along
from sextant.config.schema.parts import Choice
from sextant.errors import UserError
from sextant.runs.outputs_folder import conf_dir

KINDS = [
    faults.NoFault(),
    faults.Kidnap(0.5, 10.0),
    faults.Kidnap(12, 10.0, 15),
    faults.DroppedFrames(0.5),
    faults.Blackout(0.25, 5),
    faults.OdometryScale(1.2, 0.9),
    faults.OdometrySlip(0.5, 4, "spinning"),
    faults.OdometrySlip(0.5, 4, "sliding"),
    faults.MissingOdometry(0.5, 4),
    faults.NoisyMapPoses(0.5, 5.0),
    faults.ThinnedMap(0.3),
    faults.WrongStart(3.0, 20.0),
]


def generator(seed=0):
    return np.random.default_rng(seed)


def told_wrong(drive):
    """Frames to which odometry leads wrongly, or not at all."""
    off = np.abs(drive.motion - motions_along(drive.poses)).max(axis=1)
    return np.flatnonzero(~(off < 1e-9)).tolist()


def frozen(drive):
    return [column.copy() for column in (drive.poses, drive.motion, drive.seen, drive.frames, numbers(drive))]


@pytest.mark.parametrize("fault", KINDS, ids=repr)
def test_faults_change_no_drive_they_are_given_and_repeat_with_their_seed(fault):
    drive = circle(times_s=np.arange(40.0))
    before = frozen(drive)
    for change in (fault.drive, fault.map):
        once, again = change(drive, generator(3)), change(drive, generator(3))
        assert all(np.array_equal(a, b) for a, b in zip(frozen(drive), before, strict=True))
        assert np.array_equal(once.poses, again.poses)
        assert np.array_equal(once.seen, again.seen)
        assert np.array_equal(numbers(once), once.frames)  # pictures, scans and frames stay together
        assert np.array_equal(once.laser[:, 0], once.frames)
        if change == fault.drive:
            assert np.array_equal(once.poses, drive.poses[once.frames])
            assert (np.diff(once.times_s) > 0).all()


# -- kidnaps -----------------------------------------------------------------------------------------------------------


@given(st.integers(0, 1000), st.sampled_from([0.5, 12]), st.sampled_from([None, 1, 15]), st.floats(0.0, 12.0))
def test_a_kidnapped_robot_stands_far_away_and_its_wheels_do_not_tell(seed, frame, after, distance):
    drive = circle(40)
    taken = faults.Kidnap(frame, distance, after).drive(drive, generator(seed))
    here = 20 if frame == 0.5 else 12
    assert taken.kidnaps == (here,)
    assert len(taken) == here + (after or 40 - here)
    assert np.array_equal(taken.frames[:here], np.arange(here))
    assert (np.diff(taken.frames[here:]) == 1).all()
    assert np.linalg.norm(taken.poses[here, :2] - drive.poses[here, :2]) >= distance
    assert np.array_equal(taken.motion[here], drive.motion[here])  # an ordinary step
    assert told_wrong(taken) in ([here], [])
    if distance > 0.1:
        assert told_wrong(taken) == [here]


def test_a_run_along_a_drive_may_be_carried_to_all_of_it():
    whole = circle(120, times_s=np.arange(120.0))
    run = whole.select(30, 60, 3)
    starts = set()
    for seed in range(300):
        taken = faults.Kidnap(0.5, 15.0).drive(run, generator(seed), whole)
        assert len(taken) == len(run) == 10
        assert taken.frames[:5].tolist() == [30, 33, 36, 39, 42]
        assert (np.diff(taken.frames[5:]) == 3).all()
        assert np.array_equal(numbers(taken), taken.frames)
        assert told_wrong(taken) == [5]
        assert np.allclose(np.diff(taken.times_s), 3)
        assert np.linalg.norm(taken.poses[5, :2] - whole.poses[45, :2]) >= 15
        starts.add(int(taken.frames[5]))
    far = np.linalg.norm(whole.poses[:, :2] - whole.poses[45, :2], axis=1) >= 15
    assert starts <= set(np.flatnonzero(far[:108]).tolist())  # 4 more steps of 3 frames fit
    assert len(starts) > 0.9 * far[:108].sum()


def test_a_second_kidnap_keeps_the_first():
    once = faults.Kidnap(10, 10.0, 30).drive(circle(40), generator(1))
    twice = faults.Kidnap(25, 10.0, 10).drive(once, generator(2))
    assert {10, 25} <= set(twice.kidnaps)
    assert told_wrong(twice) == sorted(twice.kidnaps)


@pytest.mark.parametrize(
    ("fault", "told"),
    [(faults.Kidnap(0.5, 100.0), "is 100 away"), (faults.Kidnap(0.5, 1.0, 60), "has 60 of 40 frames left"),
     (faults.Kidnap(40, 1.0), r"must be in \[1, 39\]"), (faults.Blackout(0.5, 30), "40 frames"),
     (faults.OdometrySlip(30, 11), "length=10 at most")],
)  # fmt: skip
def test_a_drive_that_is_too_short_is_told(fault, told):
    with pytest.raises(UserError, match=told):
        fault.drive(circle(40), generator())


# -- camera and wheels -------------------------------------------------------------------------------------------------


def test_dropped_frames_are_a_share_and_odometry_goes_on():
    drive = circle(4000)
    dropped = faults.DroppedFrames(0.3).drive(drive, generator())
    assert dropped.seen[0]
    assert dropped.seen.mean() == pytest.approx(0.7, abs=0.03)
    assert np.array_equal(dropped.motion, drive.motion)
    again = faults.DroppedFrames(0.5).drive(dropped, generator(1))
    assert again.seen.mean() == pytest.approx(0.35, abs=0.03)  # what was lost stays lost


def test_a_blackout_is_a_stretch():
    drive = faults.Blackout(0.25, 5).drive(circle(40), generator())
    assert np.flatnonzero(~drive.seen).tolist() == [10, 11, 12, 13, 14]


def test_wheels_of_another_size():
    drive = circle(40)
    scaled = faults.OdometryScale(1.2, 0.9).drive(drive, generator())
    assert np.allclose(scaled.motion[1:, 0], 1.2 * drive.motion[1:, 0])
    assert np.allclose(scaled.motion[1:, 2], 0.9 * drive.motion[1:, 2])


def test_spinning_wheels_tell_motion_that_was_none():
    drive = replace(circle(40, times_s=np.arange(40.0)), kidnaps=(5, 30))
    slipped = faults.OdometrySlip(20, 4).drive(drive, generator())
    assert slipped.frames.tolist() == [*range(20), 19, 19, 19, 19, *range(20, 40)]
    assert told_wrong(slipped) == [20, 21, 22, 23]
    assert slipped.kidnaps == (5, 34)
    assert np.allclose(np.diff(slipped.times_s), 1)
    way = np.linalg.norm(slipped.motion[:, :2], axis=1).sum()
    assert way == pytest.approx(np.linalg.norm(drive.motion[:, :2], axis=1).sum() * 43 / 39)


def test_sliding_wheels_tell_no_motion():
    slipped = faults.OdometrySlip(20, 4, "sliding").drive(circle(40), generator())
    assert told_wrong(slipped) == [20, 21, 22, 23]
    assert (slipped.motion[20:24] == 0).all()
    assert slipped.frames.tolist() == list(range(40))


def test_missing_odometry_is_nan():
    missing = faults.MissingOdometry(20, 4).drive(circle(40), generator())
    assert np.flatnonzero(np.isnan(missing.motion).all(axis=1)).tolist() == [20, 21, 22, 23]
    for fault in (faults.OdometryScale(), faults.OdometrySlip(), faults.MissingOdometry()):
        with pytest.raises(UserError, match="no odometry"):
            fault.drive(replace(circle(40), motion=None), generator())


# -- maps --------------------------------------------------------------------------------------------------------------


def test_map_poses_err_by_what_is_said():
    drive = circle(4000)
    noisy = faults.NoisyMapPoses(0.5, 5.0).map(drive, generator())
    error = noisy.poses - drive.poses
    error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.allclose(error.std(axis=0), [0.5, 0.5, np.radians(5)], rtol=0.06)
    assert np.abs(noisy.poses[:, 2]).max() <= np.pi
    assert np.array_equal(noisy.frames, drive.frames)


def test_along_a_railway_only_the_frame_errs():
    drive = circle(100)
    line = replace(drive, poses=np.column_stack([np.arange(100.0), np.zeros((100, 2))]))
    noisy = faults.NoisyMapPoses(0.5, 5.0).map(line, generator())
    assert (noisy.poses[:, 1:] == 0).all()
    assert 0.3 < (noisy.poses[:, 0] - np.arange(100)).std() < 0.7


def test_a_thinned_map_keeps_all_directions():
    thin = faults.ThinnedMap(0.25).map(circle(400), generator())
    assert len(thin) == 100
    assert (np.diff(thin.frames) > 0).all()
    assert set((thin.frames % 8).tolist()) == set(range(8))  # eight headings at each position: none is lost
    assert thin.motion is None
    assert len(faults.ThinnedMap(0.001).map(circle(40), generator())) == 1


def seasons(*conditions):
    drives = [circle(name=f"test/{name}", condition=name) for name in conditions]
    return LocalizationData(drives[0], tuple(drives[1:]), (), None, "m", "town", other_maps=tuple(drives[1:]))


def test_a_wrong_season_map_leaves_its_own_drive_out():
    data = seasons("summer", "winter", "night")
    wrong = faults.WrongSeasonMap("night").data(data)
    assert wrong.map.condition == "night"
    assert [drive.condition for drive in wrong.test] == ["winter"]
    assert data.map.condition == "summer"
    with pytest.raises(UserError, match="no map under fog; there is one under winter, night"):
        faults.WrongSeasonMap("fog").data(data)
    with pytest.raises(UserError, match="no drive of another condition"):
        faults.WrongSeasonMap("winter").data(seasons("summer", "winter"))
    with pytest.raises(UserError, match="there is none"):
        faults.WrongSeasonMap("winter").data(replace(data, other_maps=()))


# -- config ------------------------------------------------------------------------------------------------------------


def configs():
    return {path.stem: yaml.safe_load(path.read_text()) for path in sorted((conf_dir() / "fault").glob("*.yaml"))}


def test_every_fault_has_a_config_of_its_usual_values():
    schema = TypeAdapter(Choice[FaultSchema])
    built = set()
    for name, config in configs().items():
        if name == "wrong_season_map":
            config["condition"] = "winter"
        schema.validate_python(config)
        kind = getattr(faults, config.pop("_target_").rpartition(".")[2])
        usual = kind("winter") if name == "wrong_season_map" else kind()
        assert kind(**config) == usual if config else True, name
        built.add(kind.__name__)
    assert built == set(faults.__all__) - {"Fault"}


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("kidnap", {"frame": 0.0}), ("kidnap", {"distance": -1.0}), ("kidnap", {"when": 3}), ("blackout", {"length": 0}),
     ("odometry_slip", {"kind": "skidding"}), ("thinned_map", {"keep": 0.0}), ("wrong_start", {"heading_deg": 181.0})],
)  # fmt: skip
def test_configs_with_mistakes_are_refused(name, wrong):
    with pytest.raises(ValidationError):
        TypeAdapter(Choice[FaultSchema]).validate_python(configs()[name] | wrong)
