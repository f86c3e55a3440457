"""The example nodes of ROS 1 and 2, with ROS stood in for by what they ask of it, and messages of its definitions."""

import importlib.util
import io
import math
import re
import sys
from array import array
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from made_up_bags import Bags
from PIL import Image
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from sextant import Localizer
from sextant.errors import UserError

EXAMPLES = Path(__file__).parents[2] / "examples"
RNG = np.random.default_rng(0)
#: a wall of noise along which the camera looks: an image every metre
WALL = RNG.integers(0, 255, (32, 40 * 8 + 48, 3), np.uint8)
TRANSFORMS = "tf2_msgs/msg/TFMessage"
STATE, STATES = "diagnostic_msgs/msg/DiagnosticStatus", "diagnostic_msgs/msg/DiagnosticArray"


def seen_at(metre):
    return np.ascontiguousarray(WALL[:, round(8 * metre) : round(8 * metre) + 48])


class Ros:
    """What the nodes ask of ROS: parameters, publishers and subscribers, and classes of messages with empty fields."""

    def __init__(self, version, folder):
        self.version, self.bags = version, Bags(version)
        if TRANSFORMS not in self.bags.types.types:
            self.bags.types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
        self.parameters, self.published, self.heard, self.said = {"map": str(folder)}, {}, {}, []

    def blank(self, name):
        """A message whose numbers are 0, and whose lists and texts are empty."""
        values = {}
        for field, (kind, inner) in self.bags.types.fielddefs[name][1]:
            if kind == Nodetype.NAME:
                values[field] = self.blank(inner)
            elif kind == Nodetype.BASE:
                values[field] = "" if inner[0] == "string" else 0
            else:
                values[field] = [0.0] * inner[1] if kind == Nodetype.ARRAY else []
        return self.bags.types.types[name](**values)

    def kind(self, name):
        """The class of a message, which may be made from some of its fields."""
        ros = self

        class Message:
            def __new__(cls, **given):
                message = ros.blank(name)
                for field, value in given.items():
                    assert hasattr(message, field)
                    setattr(message, field, value)
                return message

        Message.__name__ = name.rpartition("/")[2]
        for level in ("OK", "WARN", "ERROR"):
            if name == STATE:
                setattr(Message, level, getattr(self.bags.types.types[name], level))
        return Message

    def publish(self, topic, message):
        """Keep a message, which must be one that can be sent."""
        write = self.bags.types.serialize_ros1 if self.version == 1 else self.bags.types.serialize_cdr
        message = as_sent(message)
        write(message, message.__msgtype__)
        self.published.setdefault(topic, []).append(message)

    def modules(self):
        """The modules that the nodes import."""
        messages = {
            "geometry_msgs": ["Pose", "PoseArray", "PoseWithCovarianceStamped", "TransformStamped"],
            "nav_msgs": ["Odometry"],
            "sensor_msgs": ["Image", "CompressedImage", "CameraInfo"],
            "diagnostic_msgs": ["DiagnosticArray", "DiagnosticStatus", "KeyValue"],
            "tf2_msgs": ["TFMessage"],
        }
        found = {}
        for package, names in messages.items():
            found[package] = {}
            found[f"{package}.msg"] = {name: self.kind(f"{package}/msg/{name}") for name in names}
        return found | (self._rospy() if self.version == 1 else self._rclpy())

    def _rospy(self):
        publisher = lambda topic, kind, queue_size: SimpleNamespace(publish=lambda m: self.publish(topic, m))  # noqa: E731
        return {
            "rospy": {
                "get_param": lambda name, default: self.parameters.get(name.removeprefix("~"), default),
                "Publisher": publisher,
                "Subscriber": lambda topic, kind, callback, **_: self.heard.update({topic: callback}),
                "Time": Stamp,
                "get_name": lambda: "/sextant_localizer",
                "resolve_name": lambda name: f"/{name}",
                "loginfo": lambda text, *values: self.said.append(text % values),
                "logwarn": lambda text, *values: self.said.append(text % values),
            }
        }

    def _rclpy(self):
        ros = self

        class Node:
            def __init__(self, name):
                self.name = name

            def declare_parameter(self, name, default, descriptor):
                value = ros.parameters.get(name, default)
                if not descriptor.dynamic_typing and type(value) is not type(default):
                    raise TypeError(f"{name} is statically typed")
                return SimpleNamespace(value=value)

            def create_publisher(self, kind, topic, depth):
                return SimpleNamespace(publish=lambda message: ros.publish(topic, message))

            def create_subscription(self, kind, topic, callback, qos):
                ros.heard[topic] = callback

            def resolve_topic_name(self, name):
                return f"/{name}"

            def get_name(self):
                return self.name

            def get_logger(self):
                return SimpleNamespace(warning=lambda text, **_: ros.said.append(text), info=ros.said.append)

        def time(nanoseconds):
            return SimpleNamespace(to_msg=lambda: ros.new_time(nanoseconds))

        return {
            "rclpy": {},
            "rcl_interfaces": {},
            "rcl_interfaces.msg": {"ParameterDescriptor": SimpleNamespace},
            "rclpy.node": {"Node": Node},
            "rclpy.qos": {"QoSProfile": SimpleNamespace, "qos_profile_sensor_data": SimpleNamespace(reliability=0)},
            "rclpy.time": {"Time": time},
        }

    def new_time(self, nanoseconds):
        seconds, rest = divmod(nanoseconds, 10**9)
        return self.bags.new("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)

    def send(self, topic, message):
        if self.version == 1:
            stamp = message.header.stamp
            message.header.stamp = Stamp(stamp.sec, stamp.nanosec)
        self.heard[topic](message)


class Stamp:
    """rospy's time."""

    def __init__(self, seconds, nanoseconds):
        self.sec, self.nanosec = seconds, nanoseconds

    def to_nsec(self):
        return self.sec * 10**9 + self.nanosec

    def __add__(self, seconds):
        return Stamp(*divmod(self.to_nsec() + round(seconds * 1e9), 10**9))


def as_sent(message):
    """The message with lists as the arrays that a writer wants."""
    for name, value in vars(message).items():
        if name == "covariance":
            message.covariance = np.array(value, float)
        elif hasattr(value, "__msgtype__"):
            as_sent(value)
    return message


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A map of the wall."""
    poses = np.stack([np.arange(40.0), np.zeros(40), np.zeros(40)], 1)
    folder = tmp_path_factory.mktemp("wall")
    Localizer.from_images(np.stack([seen_at(x) for x in range(40)]), poses, particles=500).save(folder)
    return folder


@pytest.fixture(params=[1, 2])
def ros(request, folder):
    return Ros(request.param, folder)


def start(ros, monkeypatch):
    """The node of a version."""
    for name, values in ros.modules().items():
        module = ModuleType(name)
        module.__dict__.update(values)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("node", EXAMPLES / f"ros{ros.version}_localizer.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.LocalizerNode()


def drive(ros, steps, image=None):
    """Ten metres along the wall and on, by odometry that starts elsewhere and turned by half a rad."""
    c, s = math.cos(0.5), math.sin(0.5)
    for step in range(steps):
        pixels = seen_at(10.0 + step) if image is None else image
        ros.send("odom", ros.bags.odometry(step + 1, 3 + step * c, 0.5, y=-1 + step * s))
        ros.send("image", ros.bags.image(step + 1, pixels))


def test_it_publishes_the_pose_the_transform_the_particles_and_the_state(ros, monkeypatch):
    start(ros, monkeypatch)
    drive(ros, 25)
    pose = ros.published["pose"][-1]
    assert pose.header.frame_id == "map"
    assert (pose.header.stamp.sec, pose.header.stamp.nanosec) == (25, 0)
    assert pose.pose.pose.position.x == pytest.approx(34.0, abs=0.5)
    assert pose.pose.pose.orientation.w == pytest.approx(1.0, abs=0.05)
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    assert 0 < covariance[0, 0] < 1
    assert 0 <= covariance[5, 5] < 1
    assert not covariance[2].any()
    (transform,) = ros.published["/tf"][-1].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "camera")  # of the made-up odometry
    assert transform.header.stamp.sec + transform.header.stamp.nanosec / 1e9 == pytest.approx(25.1)  # dated ahead
    turn = transform.transform.rotation
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(-0.5, abs=0.1)
    at = np.array([3 + 23 * math.cos(0.5), -1 + 23 * math.sin(0.5)])  # the odometry of the image before
    c, s = math.cos(-0.5), math.sin(-0.5)
    moved = transform.transform.translation
    assert moved.x + c * at[0] - s * at[1] == pytest.approx(33.0, abs=1.5)
    assert len(ros.published["particlecloud"][-1].poses) == 128
    (state,) = ros.published["/diagnostics"][-1].status
    assert (state.level, state.message) == (0, "localized")
    assert {each.key: each.value for each in state.values}["lost"] == "false"


def test_a_robot_that_is_lost_is_said_and_neither_pose_nor_transform_published(ros, monkeypatch):
    start(ros, monkeypatch)
    drive(ros, 2, np.random.default_rng(1).integers(0, 255, (32, 48, 3), np.uint8))
    assert "pose" not in ros.published
    assert "/tf" not in ros.published
    assert ros.said[0].startswith("lost: the likeliest place has weight ")
    assert ros.published["/diagnostics"][0].status[0].level == 2


def test_an_initial_pose_is_taken(ros, monkeypatch):
    node = start(ros, monkeypatch)
    drive(ros, 3)
    message = ros.blank("geometry_msgs/msg/PoseWithCovarianceStamped")
    message.header = ros.bags.header(3)
    message.pose.pose.position.x, message.pose.pose.orientation.w = 30.0, 1.0
    message.pose.covariance = np.diag([0.25, 0.25, 0, 0, 0, 0.07]).ravel()
    ros.send("initialpose", message)
    assert node.core.map_from_odom is not None  # before the next image
    assert ros.said[-1] == "starts again around 30.00, 0.00"
    ros.send("odom", ros.bags.odometry(4, 3 + 2 * math.cos(0.5), 0.5, y=-1 + 2 * math.sin(0.5)))
    ros.send("image", ros.bags.image(4, seen_at(30.0)))
    assert ros.published["pose"][-1].pose.pose.position.x == pytest.approx(30.0, abs=0.7)
    message.pose.pose.orientation.w = 5.0
    ros.send("initialpose", message)
    assert ros.said[-1].startswith("initialpose was ignored: a pose at 30.0, 0 with the quaternion")


def test_compressed_images_are_taken_and_unreadable_ones_left_out_with_a_warning(ros, monkeypatch):
    ros.parameters["image_transport"] = "compressed"
    node = start(ros, monkeypatch)
    assert "image" not in ros.heard
    file = io.BytesIO()
    Image.fromarray(seen_at(10)).save(file, "png")
    ros.send("image/compressed", ros.bags.compressed(1, b"no picture"))
    assert ros.published["/diagnostics"][-1].status[0].level == 2  # nothing was seen yet
    ros.send("image/compressed", ros.bags.compressed(2, file.getvalue()))
    assert (node.core.images, node.core.left_out) == (2, 1)


def test_a_camera_that_cannot_be_used_and_odometry_that_is_none_are_said(ros, monkeypatch):
    node = start(ros, monkeypatch)
    matrix = [40.0, 0, 23.5, 0, 40, 15.5, 0, 0, 1]
    ros.send("camera_info", ros.bags.camera(1, 48, 32, matrix, (0.1,) * 6, "omnidirectional"))
    assert "distortion_model='omnidirectional'" in ros.said[-1]
    ros.send("camera_info", ros.bags.camera(1, 48, 32, matrix, (0.1, 0, 0, 0, 0)))
    assert node.core.camera.lens.opencv[4] == 0.1
    odometry = ros.bags.odometry(1, math.nan, 0.0)
    ros.send("odom", odometry)
    assert ros.said[-1].startswith("odometry was left out: a pose at nan")


def test_without_a_map_it_says_how_to_give_one(ros, monkeypatch):
    ros.parameters.clear()
    with pytest.raises(UserError, match="map is missing"):
        start(ros, monkeypatch)


def test_parameters_of_ros_2_may_be_whole_numbers_and_others_are_refused(folder, monkeypatch):
    ros = Ros(2, folder)
    ros.parameters |= {"mounting": array("q", [1, 0, 90]), "odometry_timeout": 1}
    core = start(ros, monkeypatch).core
    np.testing.assert_allclose(core._base_from_camera, [[1, 0, math.pi / 2]])
    assert core._timeout_ns == 10**9
    for name, value, said in (
        ("mounting", 5, "mounting:=5 is not a list of numbers\nFor example --ros-args -p mounting:=[0.0, 0.0, 0.0]"),
        ("mounting", ["a", "b", "c"], "is not a list of numbers"),
        ("odometry_timeout", "soon", "odometry_timeout:=soon is not a number"),
        ("odometry_timeout", True, "odometry_timeout:=True is not a number"),
        ("rectify", 1, "rectify:=1 is not true or false\nFor example --ros-args -p rectify:=false"),
        ("seed", 0.5, "seed:=0.5 is not a whole number"),
        ("map", 2024, "map:=2024 is not text\nFor example --ros-args -p map:='\"2024\"'"),
    ):
        ros = Ros(2, folder)
        ros.parameters[name] = value
        with pytest.raises(UserError, match=re.escape(said)):
            start(ros, monkeypatch)
