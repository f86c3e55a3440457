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
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, PoseArray, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage

from sextant import Localizer
from sextant.chapters.localization.data.ros_messages import camera_of, planar_pose, set_planar
from sextant.chapters.localization.robot_localizer import Report, RobotLocalizer
from sextant.errors import UserError

#: types of parameters, in words
KINDS = {str: "text", bool: "true or false", int: "a whole number", float: "a number", list: "a list of numbers"}


def nanoseconds(stamp: Any) -> int:
    """Of a ``builtin_interfaces/Time``."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


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


class LocalizerNode(Node):  # type: ignore[misc]
    """Passes messages to a robot localizer, and publishes what it reports."""

    def __init__(self) -> None:
        super().__init__("sextant_localizer")
        get = self.get
        folder = get("map", "")
        if not folder:
            raise UserError("map is missing", "--ros-args -p map:=<folder of a run or of a saved localizer>")
        particles = get("particles", 0) or None
        self.core = RobotLocalizer(
            Localizer.load(folder, particles=particles, start=get("start", "uniform"), seed=get("seed", 0)),
            mounting=tuple(get("mounting", [0.0, 0.0, 0.0])),
            odometry_timeout_s=get("odometry_timeout", 0.5),
            rectify=get("rectify", False),
        )
        self.map_frame, self.odom_frame = get("map_frame", "map"), get("odom_frame", "")
        self.broadcasts, self.tolerance = get("publish_tf", True), round(get("transform_tolerance", 0.1) * 1e9)
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "pose", 10)
        self.clouds = self.create_publisher(PoseArray, "particlecloud", 2)
        self.states = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.transforms = self.create_publisher(TFMessage, "/tf", 100)
        compressed = get("image_transport", "raw") == "compressed"
        topic, self.kind = ("image/compressed", CompressedImage) if compressed else ("image", Image)
        newest = QoSProfile(depth=1, reliability=qos_profile_sensor_data.reliability)
        every = QoSProfile(depth=1000, reliability=qos_profile_sensor_data.reliability)
        self.create_subscription(CameraInfo, "camera_info", self.on_camera, newest)
        self.create_subscription(Odometry, "odom", self.on_odometry, every)
        self.create_subscription(PoseWithCovarianceStamped, "initialpose", self.on_initial_pose, 1)
        self.create_subscription(self.kind, topic, self.on_image, newest)

    def get(self, name: str, default: Any) -> Any:
        """Declare a parameter, and return its value."""
        anything = ParameterDescriptor(dynamic_typing=True)  # otherwise 1 is refused where the default is 0.5
        return converted(name, self.declare_parameter(name, default, anything).value, default)

    def on_camera(self, message: Any) -> None:
        """Keep the camera."""
        try:
            self.core.on_camera(camera_of(message, self.resolve_topic_name("image")))
        except UserError as error:
            self.warn(str(error))

    def on_odometry(self, message: Any) -> None:
        """Pass odometry on; broadcast the transform at its time."""
        try:
            pose = planar_pose(message.pose.pose)
        except ValueError as error:
            self.warn(f"odometry was left out: {error}")
            return
        self.odom_frame = self.odom_frame or message.header.frame_id
        stamp_ns = nanoseconds(message.header.stamp)
        for report in self.core.on_odometry(stamp_ns, pose):
            self.publish(report)
        self.broadcast(stamp_ns)

    def on_image(self, message: Any) -> None:
        """Localize by an image, once its odometry is known."""
        kind = f"sensor_msgs/msg/{self.kind.__name__}"
        for report in self.core.on_image(nanoseconds(message.header.stamp), message, kind):
            self.publish(report)

    def on_initial_pose(self, message: Any) -> None:
        """Start again around a pose, as RViz sends it."""
        try:
            pose, stamp_ns = planar_pose(message.pose.pose), nanoseconds(message.header.stamp)
            self.core.on_initial_pose(stamp_ns, pose, message.pose.covariance)
            self.get_logger().info(f"starts again around {pose[0]:.2f}, {pose[1]:.2f}")
        except (UserError, ValueError) as error:
            self.warn(f"initialpose was ignored: {error}")

    def publish(self, report: Report) -> None:
        """Publish the pose unless the robot is lost, the particles and the state."""
        stamp, state = Time(nanoseconds=report.stamp_ns).to_msg(), report.diagnostics
        if not report.lost:
            pose = PoseWithCovarianceStamped()
            pose.header.stamp, pose.header.frame_id = stamp, self.map_frame
            set_planar(pose.pose.pose, report.pose)
            pose.pose.covariance = report.covariance.ravel().tolist()
            self.poses.publish(pose)
        cloud = PoseArray()
        cloud.header.stamp, cloud.header.frame_id = stamp, self.map_frame
        cloud.poses = [set_planar(Pose(), each) for each in report.particles]
        self.clouds.publish(cloud)
        status = DiagnosticStatus(level=getattr(DiagnosticStatus, state.level), message=state.message)
        status.name, status.hardware_id = f"{self.get_name()}: localization", "camera"
        status.values = [KeyValue(key=key, value=value) for key, value in state.values.items()]
        states = DiagnosticArray(status=[status])
        states.header.stamp = stamp
        self.states.publish(states)
        if state.level != "OK":
            self.warn(state.message)

    def broadcast(self, stamp_ns: int) -> None:
        """Broadcast map -> odom, valid for a while after the odometry."""
        if self.broadcasts and self.core.map_from_odom is not None:
            transform = TransformStamped(child_frame_id=self.odom_frame)
            transform.header.stamp = Time(nanoseconds=stamp_ns + self.tolerance).to_msg()
            transform.header.frame_id = self.map_frame
            set_planar(transform.transform, self.core.map_from_odom)
            self.transforms.publish(TFMessage(transforms=[transform]))

    def warn(self, text: str) -> None:
        """Warn, at most every five seconds."""
        self.get_logger().warning(text, throttle_duration_sec=5.0)


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
