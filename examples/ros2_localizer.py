"""A ROS 2 node that localizes a robot by its camera and odometry.

    python3 examples/ros2_localizer.py --ros-args -p map:=outputs/runs/localization/<run> -r image:=/camera/image_raw

It needs rclpy, and Sextant in the same Python. ``map`` is the folder of a run of ``task=localization``, or one that
``Localizer.save`` wrote. For each image on ``image`` (``sensor_msgs/Image``) it publishes
``geometry_msgs/PoseWithCovarianceStamped`` on ``pose``, in the frame ``map``; motion comes from ``odom``
(``nav_msgs/Odometry``), and is unknown until the first message. While the robot is lost, a warning is
logged and no pose is published.
"""

import math
from typing import Any

import numpy as np
import rclpy
import torch
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

from sextant import Localizer
from sextant.chapters.localization.data.rosbag import picture_of
from sextant.geometry import se2_between

#: rows of x, y and yaw in the covariance of x, y, z and the rotations about them
PLANE = np.ix_([0, 1, 5], [0, 1, 5])


class LocalizerNode(Node):  # type: ignore[misc]
    """Steps a localizer with each image and the motion that odometry reports since the last one."""

    def __init__(self) -> None:
        super().__init__("sextant_localizer")
        folder = self.declare_parameter("map", "").value
        if not folder:
            raise SystemExit("map is missing: --ros-args -p map:=<folder of a run or of a saved localizer>")
        self.localizer = Localizer.load(folder)
        self.odometry: torch.Tensor | None = None  # x, y and heading, the newest
        self.before: torch.Tensor | None = None  # the same at the last image
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "pose", 10)
        self.create_subscription(Odometry, "odom", self.on_odometry, qos_profile_sensor_data)
        self.create_subscription(Image, "image", self.on_image, qos_profile_sensor_data)

    def on_odometry(self, message: Any) -> None:
        """Keep the newest odometry."""
        at, turned = message.pose.pose.position, message.pose.pose.orientation
        heading = 2 * math.atan2(turned.z, turned.w)  # on the ground it turns about z alone
        self.odometry = torch.tensor([at.x, at.y, heading], dtype=torch.float64)

    def on_image(self, message: Any) -> None:
        """Step the localizer and publish the pose."""
        unknown = self.before is None or self.odometry is None
        motion = None if unknown else se2_between(self.before, self.odometry).numpy()
        self.before = self.odometry
        try:
            image = np.asarray(picture_of(message, "sensor_msgs/msg/Image").convert("RGB"))
        except ValueError as error:  # an unsupported encoding, or a damaged message
            self.get_logger().warning(f"an image was left out: {error}", throttle_duration_sec=5.0)
            image = None
        told = self.localizer.step(motion, image)
        if told.lost:
            self.get_logger().warning(
                f"lost: the likeliest place has weight {told.mass:.0%}", throttle_duration_sec=5.0
            )
            return
        pose = PoseWithCovarianceStamped()
        pose.header.stamp, pose.header.frame_id = message.header.stamp, "map"
        x, y, heading = map(float, told.pose)
        pose.pose.pose.position.x, pose.pose.pose.position.y = x, y
        pose.pose.pose.orientation.z, pose.pose.pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)
        covariance = np.zeros((6, 6))
        covariance[PLANE] = told.covariance
        pose.pose.covariance = covariance.ravel().tolist()
        self.poses.publish(pose)


def main() -> None:
    """Run until interrupted."""
    rclpy.init()
    node = LocalizerNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
