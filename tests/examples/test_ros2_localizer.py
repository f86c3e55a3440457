"""The example node of ROS 2, with ROS stood in for by what the node asks of it, and messages of its own definitions."""

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from made_up_bags import Bags

from sextant import Localizer

SCRIPT = Path(__file__).parents[2] / "examples" / "ros2_localizer.py"
RNG = np.random.default_rng(0)
#: a wall of noise along which the camera looks: an image every metre
WALL = RNG.integers(0, 255, (32, 40 * 8 + 48, 3), np.uint8)


def seen_at(metre):
    return WALL[:, round(8 * metre) : round(8 * metre) + 48]


class FakeNode:
    """What rclpy's node is asked for."""

    map = ""

    def __init__(self, name):
        self.said, self.published, self.heard = [], [], {}

    def declare_parameter(self, name, value):
        return SimpleNamespace(value=self.map)

    def create_publisher(self, kind, topic, depth):
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, kind, topic, callback, qos):
        self.heard[topic] = callback

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, **_: self.said.append(text))


def empty_pose():
    point = lambda: SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)  # noqa: E731
    pose = SimpleNamespace(position=point(), orientation=point())
    return SimpleNamespace(header=SimpleNamespace(), pose=SimpleNamespace(pose=pose, covariance=[]))


@pytest.fixture
def node(tmp_path, monkeypatch):
    """The node on a map of the wall."""
    poses = np.stack([np.arange(40.0), np.zeros(40), np.zeros(40)], 1)
    Localizer.from_images(np.stack([seen_at(x) for x in range(40)]), poses, particles=500).save(tmp_path / "map")
    FakeNode.map = str(tmp_path / "map")
    contents = {
        "rclpy": {},
        "rclpy.node": {"Node": FakeNode},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "geometry_msgs.msg": {"PoseWithCovarianceStamped": empty_pose},
        "nav_msgs.msg": {"Odometry": object},
        "sensor_msgs.msg": {"Image": object},
    }
    for name, values in contents.items():
        module = ModuleType(name)
        module.__dict__.update(values)
        monkeypatch.setitem(sys.modules, name, module)
        if "." in name and name.partition(".")[0] not in contents:
            monkeypatch.setitem(sys.modules, name.partition(".")[0], ModuleType(name.partition(".")[0]))
    spec = importlib.util.spec_from_file_location("ros2_localizer", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.LocalizerNode()


def test_it_follows_a_robot_by_its_camera_and_odometry(node):
    bags = Bags(2)
    turned = 0.5  # odometry starts anywhere, and turned
    for step in range(25):
        x = 10.0 + step
        node.heard["odom"](bags.odometry(step, 3 + step * math.cos(turned), turned, y=-1 + step * math.sin(turned)))
        node.heard["image"](bags.image(step, np.ascontiguousarray(seen_at(x))))
    last = node.published[-1]
    assert last.header.frame_id == "map"
    assert last.header.stamp.sec == 24
    assert last.pose.pose.position.x == pytest.approx(34.0, abs=0.5)
    assert last.pose.pose.orientation.w == pytest.approx(1.0, abs=0.05)
    covariance = np.reshape(last.pose.covariance, (6, 6))
    assert 0 < covariance[0, 0] < 1
    assert 0 <= covariance[5, 5] < 1
    assert not covariance[2].any()


def test_a_robot_that_is_lost_is_warned_of_and_not_published(node):
    bags = Bags(2)
    noise = np.random.default_rng(1).integers(0, 255, (32, 48, 3), np.uint8)
    node.heard["image"](bags.image(0, noise))  # without odometry, its motion is unknown
    assert not node.published
    assert node.said[0].startswith("lost: the likeliest place has weight ")


def test_an_image_that_cannot_be_read_is_left_out_with_a_warning(node):
    bags = Bags(2)
    node.heard["image"](bags.image(0, np.ascontiguousarray(seen_at(10)), encoding="bayer_rggb8"))
    assert node.said[0].startswith("an image was left out: encoding bayer_rggb8 is not one of mono8")
    node.heard["image"](bags.image(1, np.ascontiguousarray(seen_at(10))))
    assert node.localizer.belief is not None
