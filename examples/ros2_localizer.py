"""A ROS 2 node that localizes a robot by its camera and odometry, and publishes map -> odom (REP 105).

    python3 examples/ros2_localizer.py --ros-args -p map:=outputs/runs/localization/<run> -r image:=/camera/image_raw

It needs rclpy, and Sextant in the same Python. It subscribes to ``image`` (``sensor_msgs/Image``) or
``image/compressed``, ``camera_info``, ``odom`` (``nav_msgs/Odometry``) and ``initialpose``; it publishes ``pose``
(``geometry_msgs/PoseWithCovarianceStamped``), ``particlecloud`` (``geometry_msgs/PoseArray``), ``/diagnostics``
(``diagnostic_msgs/DiagnosticArray``) and ``/tf``. While the robot is lost, neither the pose nor the transform is
published. Parameters:

======================= =============== ==========================================================================
``map``                                 a run of ``task=localization``, or a folder that ``Localizer.save`` wrote
``mounting``            [0.0, 0.0, 0.0] the camera on the base: metres ahead, metres to the left, degrees to the left
``image_transport``     raw             ``compressed`` subscribes to ``image/compressed``
``rectify``             false           straighten images by ``camera_info``, for a map of images without distortion
``particles``           0               number of particles; 0: that of the map's test
``start``               uniform         first particles: ``uniform``, or ``appearance``, at similar map images
``seed``                0               of random numbers
``odometry_timeout``    0.5             seconds that an image waits for odometry of its time
``map_frame``           map             frame of the map
``odom_frame``                          frame of the odometry; empty: that of its messages
``publish_tf``          true            false publishes no transform
``transform_tolerance`` 0.1             seconds that a transform is dated ahead, so that it is valid until the next
======================= =============== ==========================================================================
"""

from array import array
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.time import Time

from sextant.chapters.localization.ros_node import RosNode
from sextant.errors import UserError

#: types of parameters, in words
KINDS = {str: "text", bool: "true or false", int: "a whole number", float: "a number", list: "a list of numbers"}


def converted(name: str, value: Any, default: Any) -> Any:
    """A parameter's value, of its default's type; a whole number also serves as a float, and whole numbers as a list.

    Raises:
        UserError: it is of another type.
    """
    kind, several = type(default), isinstance(value, list | tuple | array)
    numbers = all(type(each) in (int, float) for each in (value if several else [value]))
    if kind is list and several and numbers:
        return [float(each) for each in value]
    if kind is float and not several and numbers:
        return float(value)
    if type(value) is kind and kind is not list:
        return value
    example = f"'\"{value}\"'" if kind is str else str(default).lower()
    raise UserError(f"{name}:={value} is not {KINDS[kind]}", f"For example --ros-args -p {name}:={example}")


class LocalizerNode(RosNode, Node):  # type: ignore[misc]
    """Passes messages to a robot localizer, and publishes what it reports."""

    def __init__(self) -> None:
        Node.__init__(self, "sextant_localizer")
        self.set_up(self.get, "--ros-args -p map:=<folder of a run or of a saved localizer>")
        for topic, (kind, heard, depth) in self.topics().items():
            quality = QoSProfile(depth=depth, reliability=qos_profile_sensor_data.reliability)
            self.create_subscription(kind, topic, heard, depth if topic == "initialpose" else quality)

    def get(self, name: str, default: Any) -> Any:
        """Declare a parameter, and return its value."""
        anything = ParameterDescriptor(dynamic_typing=True)  # otherwise 1 is refused where the default is 0.5
        return converted(name, self.declare_parameter(name, default, anything).value, default)

    def publisher(self, topic: str, kind: Any, depth: int) -> Any:
        """A publisher."""
        return self.create_publisher(kind, topic, depth)

    def stamp(self, nanoseconds: int) -> Any:
        """A time as messages have it."""
        return Time(nanoseconds=nanoseconds).to_msg()

    def full_name(self, topic: str) -> str:
        """The name of a topic after remapping; of the node for an empty one."""
        return str(self.resolve_topic_name(topic) if topic else self.get_name())

    def tell(self, text: str, *, warning: bool) -> None:
        """Write a line to the log."""
        logger = self.get_logger()
        (logger.warning if warning else logger.info)(text)


def main() -> None:
    """Run until interrupted."""
    rclpy.init()
    try:
        node = LocalizerNode()
    except UserError as error:
        raise SystemExit(str(error)) from None
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
