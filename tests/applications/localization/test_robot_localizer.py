"""A localizer between a robot's messages: frames of REP 105, times, the initial pose and the covariance."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from made_up_bags import Bags

from sextant import Localizer
from sextant.chapters.localization.data.ros_messages import camera_of, planar_pose, set_planar
from sextant.chapters.localization.localized_pose import LocalizedPose
from sextant.chapters.localization.robot_localizer import RobotLocalizer
from sextant.errors import UserError

BAGS = Bags(2)
RNG = np.random.default_rng(0)
#: a wall of noise along which the camera looks: an image every metre
WALL = RNG.integers(0, 255, (32, 60 * 8 + 48, 3), np.uint8)


def ns(seconds):
    return round(seconds * 1e9)


def seen_at(metre):
    return np.ascontiguousarray(WALL[:, round(8 * metre) : round(8 * metre) + 48])


def image(pixels=None, encoding="rgb8"):
    return BAGS.image(0, seen_at(0) if pixels is None else pixels, encoding)


def matrix(pose):
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1.0]])


def vector(found):
    return np.array([found[0, 2], found[1, 2], math.atan2(found[1, 0], found[0, 0])])


class Stub:
    """A localizer that says what it is told to, and keeps what it is given."""

    image_size, odometry_scale = (32, 48, 3), 1.0
    descriptor = SimpleNamespace(describer=object())

    def __init__(self, pose=(0, 0, 0), covariance=None, **told):
        self.told = {"mass": 0.9, "modes": 1, "lost": False, **told}
        self.pose, self.covariance = np.array(pose, float), np.eye(3) if covariance is None else covariance
        self.motions, self.images, self.starts = [], [], []
        particles = torch.from_numpy(self.pose).expand(1, 10, 3)
        self.belief = SimpleNamespace(poses=particles, weights=torch.full((1, 10), 0.1, dtype=torch.float64))

    def step(self, motion, pixels):
        self.motions.append(motion)
        self.images.append(pixels)
        return LocalizedPose(self.pose, self.covariance, **self.told)

    def reset(self, seed=None, start=None):
        self.starts.append(start)


def test_the_transform_takes_the_odometry_of_the_images_time_to_the_pose_of_the_base():
    camera, mounting = (4.0, -3.0, 2.5), (0.4, -0.2, 30.0)
    core = RobotLocalizer(Stub(camera), mounting=mounting)
    early, late = np.array([1.0, 2.0, 3.0]), np.array([1.5, 2.5, -3.1])  # the heading passes π
    core.on_odometry(ns(10.0), early)
    assert core.on_image(ns(10.25), image()) == []  # its odometry is not known yet
    (report,) = core.on_odometry(ns(10.5), late)
    base = matrix(camera) @ np.linalg.inv(matrix((0.4, -0.2, math.radians(30))))
    turn = (late[2] - early[2] + math.pi) % (2 * math.pi) - math.pi
    at_image = (early + late) / 2
    at_image[2] = early[2] + turn / 2
    np.testing.assert_allclose(matrix(report.pose), base, atol=1e-12)
    np.testing.assert_allclose(matrix(report.map_from_odom) @ matrix(at_image), base, atol=1e-12)
    np.testing.assert_allclose(matrix(report.particles[3]), base, atol=1e-12)


def test_the_motion_is_that_of_the_camera_on_the_base():
    stub = Stub()
    core = RobotLocalizer(stub, mounting=(0.4, -0.2, 30.0))
    bases = [(0.0, 0.0, 0.0), (1.0, 0.5, 0.7), (1.0, 0.5, 1.5)]
    for second, base in enumerate(bases):
        core.on_odometry(ns(second), np.array(base))
        core.on_image(ns(second), image())
    mounted = matrix((0.4, -0.2, math.radians(30)))
    cameras = [matrix(base) @ mounted for base in bases]
    assert stub.motions[0] is None
    for k in (1, 2):
        expected = vector(np.linalg.inv(cameras[k - 1]) @ cameras[k])
        np.testing.assert_allclose(stub.motions[k], expected, atol=1e-12)


def test_odometry_that_does_not_come_is_not_waited_for_longer_than_the_timeout():
    stub = Stub()
    core = RobotLocalizer(stub, odometry_timeout_s=0.5)
    (report,) = core.on_image(ns(1.0), image())  # none has come at all
    assert report.map_from_odom is None
    assert report.diagnostics.message == "no odometry at the time of the image: no transform"
    for second in (1.0, 2.0):
        core.on_odometry(ns(second), np.array([second, 0, 0]))
    assert core.on_image(ns(2.1), image()) == []
    assert core.on_image(ns(2.4), image()) == []
    (first,) = core.on_image(ns(2.7), image())
    assert (first.stamp_ns, first.map_from_odom) == (ns(2.1), None)
    second, third = core.on_odometry(ns(2.8), np.array([2.8, 0, 0]))  # it has come after all
    assert (second.stamp_ns, third.stamp_ns) == (ns(2.4), ns(2.7))
    np.testing.assert_allclose(third.map_from_odom, [-2.7, 0, 0], atol=1e-12)
    assert stub.motions[1] is None
    assert stub.motions[2] is None  # from an image at an unknown place
    np.testing.assert_allclose(stub.motions[3], [0.3, 0, 0], atol=1e-12)


def test_messages_out_of_order_are_left_out_and_time_that_is_set_back_begins_anew():
    stub = Stub()
    core = RobotLocalizer(stub)
    for second in (10.0, 11.0):
        core.on_odometry(ns(second), np.array([second, 0, 0]))
        core.on_image(ns(second), image())
    core.on_odometry(ns(10.9), np.array([99.0, 0, 0]))
    assert core.on_image(ns(10.9), image()) == []
    assert core.left_out == 1
    assert core.on_image(ns(11.2), image()) == []  # waits
    assert core.map_from_odom is not None
    core.on_odometry(ns(3.0), np.array([3.0, 0, 0]))  # the bag is played again
    assert core.left_out == 2
    assert core.map_from_odom is None
    (report,) = core.on_image(ns(3.0), image())
    assert stub.motions[-1] is None
    np.testing.assert_allclose(report.map_from_odom, [-3, 0, 0], atol=1e-12)


@pytest.mark.parametrize("late", ["images", "odometry"])
def test_a_topic_that_is_late_by_more_than_a_second_is_not_time_that_is_set_back(late):
    stub, reports = Stub(), []
    core = RobotLocalizer(stub, odometry_timeout_s=2.0)
    core.on_odometry(0, np.zeros(3))
    for tick in range(100):  # odometry at 20 Hz, images at 2 Hz, either of which comes 1.2 s after the other
        moved, seen = (tick, tick - 24) if late == "images" else (tick - 24, tick)
        if moved >= 0:
            reports += core.on_odometry(ns(moved / 20), np.array([moved / 20, 0, 0]))
        if seen >= 0 and seen % 10 == 0:
            reports += core.on_image(ns(seen / 20), image())
    assert [report.stamp_ns for report in reports] == [ns(k / 2) for k in range(len(reports))]
    assert len(reports) == 8
    assert core.left_out == 0
    np.testing.assert_allclose(stub.motions[1:], np.tile([0.5, 0, 0], (7, 1)), atol=1e-12)


def test_images_that_are_set_back_begin_anew_without_the_transform_of_an_initial_pose():
    core = RobotLocalizer(Stub(lost=True))
    core.on_odometry(ns(10.0), np.array([1.0, 0, 0]))
    core.on_initial_pose(ns(10.0), np.array([10.0, 0.0, 0.0]))
    core.on_image(ns(10.0), image())
    assert core.map_from_odom is not None
    (report,) = core.on_image(ns(3.0), image())
    assert (report.map_from_odom, core.map_from_odom) == (None, None)


def test_the_covariance_is_by_rows_of_x_y_z_roll_pitch_yaw_and_of_the_base():
    covariance = np.array([[0.4, 0.1, 0.02], [0.1, 0.3, 0.01], [0.02, 0.01, 0.05]])
    (report,) = RobotLocalizer(Stub((4, -3, 2.5), covariance)).on_image(1, image())
    assert report.covariance[0, 0] == 0.4
    assert report.covariance[0, 1] == report.covariance[1, 0] == 0.1
    assert report.covariance[0, 5] == report.covariance[5, 0] == 0.02
    assert report.covariance[5, 5] == 0.05
    assert not report.covariance[2:5].any()
    assert not report.covariance[:, 2:5].any()
    # a camera off the middle: the covariance of poses of the base that are computed one by one
    mounting, small = (0.8, -0.5, 40.0), 1e-4 * covariance
    (report,) = RobotLocalizer(Stub((4, -3, 2.5), small), mounting=mounting).on_image(1, image())
    cameras = np.random.default_rng(1).multivariate_normal([4, -3, 2.5], small, 20_000)
    back = np.linalg.inv(matrix((0.8, -0.5, math.radians(40))))
    bases = np.array([vector(matrix(camera) @ back) for camera in cameras])
    found = report.covariance[np.ix_([0, 1, 5], [0, 1, 5])]
    np.testing.assert_allclose(found, np.cov(bases.T), atol=3e-2 * np.abs(found).max())


def test_an_initial_pose_restarts_around_it_where_odometry_has_brought_the_robot_since():
    stub = Stub((0, 0, 0))
    core = RobotLocalizer(stub, mounting=(0.4, 0.0, 90.0))
    core.on_odometry(ns(1), np.array([5.0, 5.0, math.pi / 2]))
    covariance = np.diag([0.25, 0.09, 0, 0, 0, 0.04])
    core.on_initial_pose(ns(1), np.array([10.0, 20.0, 0.0]), covariance)
    np.testing.assert_allclose(
        matrix(core.map_from_odom) @ matrix((5, 5, math.pi / 2)), matrix((10, 20, 0)), atol=1e-12
    )
    core.on_odometry(ns(2), np.array([5.0, 8.0, math.pi / 2]))  # three metres ahead
    core.on_image(ns(2), image())
    (start,) = stub.starts
    np.testing.assert_allclose(start.mean.numpy(), [[13.4, 20, math.pi / 2]], atol=1e-12)
    assert start.sigma == pytest.approx((0.5, 0.3, 0.2))
    core.on_image(ns(2), image())
    assert len(stub.starts) == 1  # once
    core.on_initial_pose(0, np.array([10.0, 20.0, 0.0]), np.zeros(36))  # without a time or a covariance
    core.on_odometry(ns(3), np.array([5.0, 9.0, math.pi / 2]))
    core.on_image(ns(3), image())
    assert stub.starts[1].sigma == pytest.approx((0.5, 0.5, math.pi / 12))
    for pose, given in (((np.nan, 0, 0), np.eye(6)), ((0, 0, 0), -np.eye(6))):
        with pytest.raises(UserError, match="initial pose"):
            core.on_initial_pose(0, np.array(pose, float), given)


def test_the_transform_of_an_initial_pose_stays_until_images_decide():
    stub = Stub(lost=True)  # spread as widely as the initial pose says, no place has half of the weight yet
    core = RobotLocalizer(stub)
    core.on_odometry(ns(1), np.array([1.0, 0, 0]))
    core.on_initial_pose(ns(1), np.array([10.0, 0.0, 0.0]))
    for second in (1, 2):
        core.on_odometry(ns(second), np.array([second, 0.0, 0.0]))
        (report,) = core.on_image(ns(second), image())
        np.testing.assert_allclose(report.map_from_odom, [9, 0, 0], atol=1e-12)
        assert report.lost
        assert report.diagnostics.message == "not found yet near the initial pose"
    stub.told["foreseen"] = 0.5
    core.on_odometry(ns(3), np.array([3.0, 0, 0]))
    (report,) = core.on_image(ns(3), image())
    assert report.map_from_odom is None
    assert report.diagnostics.level == "ERROR"


@pytest.mark.parametrize(
    ("told", "level", "message"),
    [
        ({}, "OK", "localized"),
        ({"lost": True, "mass": 0.3}, "ERROR", "lost: the likeliest place has weight 30%"),
        ({"off_map": 0.8}, "WARN", "probably outside of the mapped area"),
        ({"disbelieved": True}, "WARN", "odometry reports a standstill, but images change"),
    ],
)
def test_diagnostics_tell_how_far_the_pose_may_be_believed(told, level, message):
    core = RobotLocalizer(Stub(foreseen=0.91, **told))
    core.on_odometry(ns(1), np.zeros(3))
    (report,) = core.on_image(ns(1), image())
    assert (report.diagnostics.level, report.diagnostics.message) == (level, message)
    assert report.diagnostics.values["foreseen"] == "0.910"
    assert report.diagnostics.values["off_map"] == f"{told.get('off_map', 0):.3f}"
    assert report.lost == (level == "ERROR")
    assert (report.map_from_odom is None) == (core.map_from_odom is None) == (level == "ERROR")


def test_images_are_straightened_by_their_camera_and_left_out_before_it_is_known():
    stub = Stub()
    core = RobotLocalizer(stub, rectify=True)
    (report,) = core.on_image(1, image())
    assert stub.images == [None]
    assert report.diagnostics.message == "rectify is set, but no calibrated camera_info has arrived"
    info = BAGS.camera(1, 48, 32, [[40.0, 0, 23.5], [0, 40, 15.5], [0, 0, 1]], (-0.3, 0.1, 0, 0, 0))
    core.on_camera(camera := camera_of(info, "/image"))
    core.on_image(2, image())
    np.testing.assert_array_equal(stub.images[1], camera.straight(seen_at(0), ""))
    assert (stub.images[1] != seen_at(0)).any()


def test_an_image_that_cannot_be_read_is_a_step_without_image_and_said():
    stub = Stub()
    core = RobotLocalizer(stub)
    core.on_odometry(1, np.zeros(3))
    (report,) = core.on_image(1, image(encoding="32FC1"))
    assert stub.images == [None]
    assert report.diagnostics.message.startswith("an image was left out: encoding 32FC1 is not one of mono8")
    assert report.diagnostics.values["images_left_out"] == "1"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"mounting": (0.1, 0.2)}, r"mounting=\[0.1, 0.2\] must be"),
        ({"odometry_timeout_s": -1}, "odometry_timeout_s=-1"),
    ],
)
def test_wrong_arguments_are_named(given, said):
    with pytest.raises(UserError, match=said):
        RobotLocalizer(Stub(), **given)


def test_poses_of_messages_lose_roll_and_pitch_and_none_that_are_none_pass():
    point = lambda **values: SimpleNamespace(**values)  # noqa: E731
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_euler("ZYX", [2.5, 0.2, -0.3]).as_quat()
    pose = point(position=point(x=1.0, y=2.0, z=9.0), orientation=point(x=x, y=y, z=z, w=w))
    np.testing.assert_allclose(planar_pose(pose), [1, 2, 2.5], atol=1e-12)
    set_planar(pose, np.array([3.0, 4.0, -2.0]))
    np.testing.assert_allclose(planar_pose(pose), [3, 4, -2.0], atol=1e-12)
    pose.orientation.w = 7.0
    with pytest.raises(ValueError, match="is none"):
        planar_pose(pose)


@pytest.fixture(scope="module")
def wall():
    poses = np.stack([np.arange(60.0), np.zeros(60), np.zeros(60)], 1)
    return Localizer.from_images(np.stack([seen_at(x) for x in range(60)]), poses, particles=500)


def drive(core, steps, drift):
    """Metres along the wall, a step a second; odometry is off by map_from_odom = drift(step), which grows."""
    reports = []
    for step in range(steps):
        base = (10.0 + step, 0.0, 0.0)
        core.on_odometry(ns(step), vector(np.linalg.inv(matrix(drift(step))) @ matrix(base)))
        reports += core.on_image(ns(step), image(seen_at(10.0 + step)))
    return reports


def test_a_drifting_odometry_frame_is_found(wall):
    wall.reset()
    core = RobotLocalizer(wall)
    drift = lambda step: (3.0 + 0.04 * step, -1.0, 0.5)  # noqa: E731
    reports = drive(core, 40, drift)
    found = np.array([report.map_from_odom for report in reports[10:]])
    truth = np.array([drift(step) for step in range(10, 40)])
    assert np.abs(np.angle(np.exp(1j * (found[:, 2] - truth[:, 2])))).max() < 0.1
    # at the robot, rather than at the origin of odom far away, where an error of the heading is an error of metres
    bases = np.array([report.pose for report in reports[10:]])
    assert np.abs(bases - [(10.0 + step, 0, 0) for step in range(10, 40)]).max() < 0.5
    assert np.median(np.abs(bases[:, 0] - np.arange(20.0, 50.0))) < 0.2


def test_a_robot_that_was_carried_is_found_again_by_an_initial_pose(wall):
    wall.reset()
    core = RobotLocalizer(wall)
    drive(core, 15, lambda step: (3.0, 0.0, 0.0))
    core.on_odometry(ns(20), np.array([22.0, 0, 0]))
    core.on_initial_pose(ns(20), np.array([50.0, 0, 0]), np.diag([0.25, 0.25, 0, 0, 0, 0.07]))
    (report,) = core.on_image(ns(20), image(seen_at(50.0)))
    np.testing.assert_allclose(report.pose[:2], [50, 0], atol=0.5)
    np.testing.assert_allclose(report.map_from_odom[0], 28, atol=0.7)
    assert not report.lost
