"""A ROS 1 node that localizes a robot by its camera and odometry, and publishes map -> odom (REP 105).

    python3 examples/ros1_localizer.py _map:=outputs/runs/localization/<run> image:=/camera/image_raw

It needs rospy, and Sextant in the same Python, such as a virtual environment with system packages. Parameters and
topics are those of ``ros2_localizer.py``: ``_name:=value`` sets a parameter, ``topic:=/other`` another topic.
"""

import threading
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, PoseArray, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage

from sextant import Localizer
from sextant.chapters.localization.data.ros_messages import camera_of, planar_pose, set_planar
from sextant.chapters.localization.robot_localizer import Report, RobotLocalizer
from sextant.errors import UserError


class LocalizerNode:
    """Passes messages to a robot localizer, and publishes what it reports."""

    def __init__(self) -> None:
        get = lambda name, default: rospy.get_param(f"~{name}", default)  # noqa: E731
        if not get("map", ""):
            raise UserError("map is missing", "_map:=<folder of a run or of a saved localizer>")
        particles = get("particles", 0) or None
        localizer = Localizer.load(
            get("map", ""), particles=particles, start=get("start", "uniform"), seed=get("seed", 0)
        )
        self.core = RobotLocalizer(
            localizer,
            mounting=tuple(get("mounting", [0.0, 0.0, 0.0])),
            odometry_timeout_s=get("odometry_timeout", 0.5),
            rectify=get("rectify", False),
        )
        self.map_frame, self.odom_frame = get("map_frame", "map"), get("odom_frame", "")
        self.broadcasts, self.tolerance = get("publish_tf", True), rospy.Duration(get("transform_tolerance", 0.1))
        self.lock = threading.Lock()  # rospy calls each topic's function in a thread of its own
        self.poses = rospy.Publisher("pose", PoseWithCovarianceStamped, queue_size=10)
        self.clouds = rospy.Publisher("particlecloud", PoseArray, queue_size=2)
        self.states = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)
        self.transforms = rospy.Publisher("/tf", TFMessage, queue_size=100)
        compressed = get("image_transport", "raw") == "compressed"
        topic, self.kind = ("image/compressed", CompressedImage) if compressed else ("image", Image)
        listen = rospy.Subscriber
        self.subscribers = [
            listen("camera_info", CameraInfo, self.on_camera, queue_size=1),
            listen("odom", Odometry, self.on_odometry, queue_size=1000),
            listen("initialpose", PoseWithCovarianceStamped, self.on_initial_pose, queue_size=1),
            listen(topic, self.kind, self.on_image, queue_size=1, buff_size=2**26),  # only the newest image counts
        ]

    def on_camera(self, message: Any) -> None:
        """Keep the camera."""
        try:
            self.core.on_camera(camera_of(message, rospy.resolve_name("image")))
        except UserError as error:
            rospy.logwarn_throttle(5.0, str(error))

    def on_odometry(self, message: Any) -> None:
        """Pass odometry on; broadcast the transform at its time."""
        try:
            pose = planar_pose(message.pose.pose)
        except ValueError as error:
            rospy.logwarn_throttle(5.0, f"odometry was left out: {error}")
            return
        self.odom_frame = self.odom_frame or message.header.frame_id
        with self.lock:
            for report in self.core.on_odometry(message.header.stamp.to_nsec(), pose):
                self.publish(report)
            self.broadcast(message.header.stamp)

    def on_image(self, message: Any) -> None:
        """Localize by an image, once its odometry is known."""
        kind = f"sensor_msgs/msg/{self.kind.__name__}"
        with self.lock:
            for report in self.core.on_image(message.header.stamp.to_nsec(), message, kind):
                self.publish(report)

    def on_initial_pose(self, message: Any) -> None:
        """Start again around a pose, as RViz sends it."""
        try:
            with self.lock:
                pose, stamp = planar_pose(message.pose.pose), message.header.stamp.to_nsec()
                self.core.on_initial_pose(stamp, pose, message.pose.covariance)
            rospy.loginfo("starts again around %.2f, %.2f", pose[0], pose[1])
        except (UserError, ValueError) as error:
            rospy.logwarn(f"initialpose was ignored: {error}")

    def publish(self, report: Report) -> None:
        """Publish the pose unless the robot is lost, the particles and the state."""
        stamp, state = rospy.Time(*divmod(report.stamp_ns, 10**9)), report.diagnostics
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
        status.name, status.hardware_id = f"{rospy.get_name().strip('/')}: localization", "camera"
        status.values = [KeyValue(key=key, value=value) for key, value in state.values.items()]
        states = DiagnosticArray(status=[status])
        states.header.stamp = stamp
        self.states.publish(states)
        if state.level != "OK":
            rospy.logwarn_throttle(5.0, state.message)

    def broadcast(self, stamp: Any) -> None:
        """Broadcast map -> odom, valid for a while after the odometry."""
        if self.broadcasts and self.core.map_from_odom is not None:
            transform = TransformStamped(child_frame_id=self.odom_frame)
            transform.header.stamp, transform.header.frame_id = stamp + self.tolerance, self.map_frame
            set_planar(transform.transform, self.core.map_from_odom)
            self.transforms.publish(TFMessage(transforms=[transform]))


def main() -> None:
    """Run until interrupted."""
    rospy.init_node("sextant_localizer")
    try:
        node = LocalizerNode()
    except UserError as error:
        raise SystemExit(str(error)) from None
    rospy.loginfo("%r", node.core.localizer)
    rospy.spin()


if __name__ == "__main__":
    main()
