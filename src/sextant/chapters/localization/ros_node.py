"""What the nodes of ROS 1 and 2 have in common: parameters, topics, and messages made of reports.

ROS is imported only when a node starts. ``examples/ros1_localizer.py`` and ``ros2_localizer.py`` add the rest.
"""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib import import_module
from types import SimpleNamespace
from typing import Any

from sextant.chapters.localization.data.ros_messages import camera_of, planar_pose, set_planar
from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.robot_localizer import Report, RobotLocalizer
from sextant.errors import UserError

#: package -> messages that are received or sent
MESSAGES = {
    "diagnostic_msgs": ("DiagnosticArray", "DiagnosticStatus", "KeyValue"),
    "geometry_msgs": ("Pose", "PoseArray", "PoseWithCovarianceStamped", "TransformStamped"),
    "nav_msgs": ("Odometry",),
    "sensor_msgs": ("CameraInfo", "CompressedImage", "Image"),
    "tf2_msgs": ("TFMessage",),
}
#: seconds between two warnings of one kind
SILENCE = 5.0


class RosNode(ABC):
    """Passes messages to a robot localizer, and publishes what it reports."""

    def set_up(self, get: Callable[[str, Any], Any], usage: str) -> None:
        """Load the map, and publish.

        Args:
            get: a parameter's value, given its name and default.
            usage: how to name a map, for the message that none is.

        Raises:
            UserError: no map is named, or a parameter is wrong.
        """
        folder = get("map", "")
        if not folder:
            raise UserError("map is missing", usage)
        particles = get("particles", 0) or None
        self.core = RobotLocalizer(
            Localizer.load(folder, particles=particles, start=get("start", "uniform"), seed=get("seed", 0)),
            mounting=tuple(get("mounting", [0.0, 0.0, 0.0])),
            odometry_timeout_s=get("odometry_timeout", 0.5),
            rectify=get("rectify", False),
        )
        self.map_frame, self.odom_frame = get("map_frame", "map"), get("odom_frame", "")
        self.broadcasts, self.tolerance_ns = get("publish_tf", True), round(get("transform_tolerance", 0.1) * 1e9)
        self.compressed = get("image_transport", "raw") == "compressed"
        self.lock = threading.Lock()  # rospy calls each topic's function in a thread of its own
        self.warned = dict[str, float]()
        names = {name: package for package, names in MESSAGES.items() for name in names}
        self.kinds = SimpleNamespace(**{n: getattr(import_module(f"{package}.msg"), n) for n, package in names.items()})
        self.poses = self.publisher("pose", self.kinds.PoseWithCovarianceStamped, 10)
        self.clouds = self.publisher("particlecloud", self.kinds.PoseArray, 2)
        self.states = self.publisher("/diagnostics", self.kinds.DiagnosticArray, 10)
        self.transforms = self.publisher("/tf", self.kinds.TFMessage, 100)

    def topics(self) -> dict[str, tuple[Any, Callable[[Any], None], int]]:
        """Topics to listen to: message, function, and how many to keep. Only the newest image counts."""
        kinds = self.kinds
        image = ("image/compressed", kinds.CompressedImage) if self.compressed else ("image", kinds.Image)
        return {
            "camera_info": (kinds.CameraInfo, self.on_camera, 1),
            "odom": (kinds.Odometry, self.on_odometry, 1000),
            "initialpose": (kinds.PoseWithCovarianceStamped, self.on_initial_pose, 1),
            image[0]: (image[1], self.on_image, 1),
        }

    @abstractmethod
    def publisher(self, topic: str, kind: Any, depth: int) -> Any:
        """A publisher."""

    @abstractmethod
    def stamp(self, nanoseconds: int) -> Any:
        """A time as messages have it."""

    @abstractmethod
    def full_name(self, topic: str) -> str:
        """The name of a topic after remapping; of the node for an empty one."""

    @abstractmethod
    def tell(self, text: str, *, warning: bool) -> None:
        """Write a line to the log."""

    def on_camera(self, message: Any) -> None:
        """Keep the camera."""
        try:
            self.core.on_camera(camera_of(message, self.full_name("image")))
        except UserError as error:
            self.warn("camera", str(error))

    def on_odometry(self, message: Any) -> None:
        """Pass odometry on; broadcast the transform at its time."""
        try:
            pose = planar_pose(message.pose.pose)
        except ValueError as error:
            self.warn("odometry", f"odometry was left out: {error}")
            return
        self.odom_frame = self.odom_frame or message.header.frame_id
        stamp_ns = nanoseconds(message.header.stamp)
        with self.lock:
            for report in self.core.on_odometry(stamp_ns, pose):
                self.publish(report)
            self.broadcast(stamp_ns)

    def on_image(self, message: Any) -> None:
        """Localize by an image, once its odometry is known."""
        kind = f"sensor_msgs/msg/{'CompressedImage' if self.compressed else 'Image'}"
        with self.lock:
            for report in self.core.on_image(nanoseconds(message.header.stamp), message, kind):
                self.publish(report)

    def on_initial_pose(self, message: Any) -> None:
        """Start again around a pose, as RViz sends it."""
        try:
            pose, stamp_ns = planar_pose(message.pose.pose), nanoseconds(message.header.stamp)
            with self.lock:
                self.core.on_initial_pose(stamp_ns, pose, message.pose.covariance)
            self.tell(f"starts again around {pose[0]:.2f}, {pose[1]:.2f}", warning=False)
        except (UserError, ValueError) as error:
            self.tell(f"initialpose was ignored: {error}", warning=True)

    def publish(self, report: Report) -> None:
        """Publish the pose unless the robot is lost, the particles and the state."""
        kinds, stamp, state = self.kinds, self.stamp(report.stamp_ns), report.diagnostics
        if not report.lost:
            pose = kinds.PoseWithCovarianceStamped()
            pose.header.stamp, pose.header.frame_id = stamp, self.map_frame
            set_planar(pose.pose.pose, report.pose)
            pose.pose.covariance = report.covariance.ravel().tolist()
            self.poses.publish(pose)
        cloud = kinds.PoseArray()
        cloud.header.stamp, cloud.header.frame_id = stamp, self.map_frame
        cloud.poses = [set_planar(kinds.Pose(), each) for each in report.particles]
        self.clouds.publish(cloud)
        status = kinds.DiagnosticStatus(level=getattr(kinds.DiagnosticStatus, state.level), message=state.message)
        status.name, status.hardware_id = f"{self.full_name('').strip('/')}: localization", "camera"
        status.values = [kinds.KeyValue(key=key, value=value) for key, value in state.values.items()]
        states = kinds.DiagnosticArray(status=[status])
        states.header.stamp = stamp
        self.states.publish(states)
        if state.level != "OK":
            self.warn("state", state.message)

    def broadcast(self, stamp_ns: int) -> None:
        """Broadcast map -> odom, valid for a while after the odometry."""
        if self.broadcasts and self.core.map_from_odom is not None:
            transform = self.kinds.TransformStamped(child_frame_id=self.odom_frame)
            transform.header.stamp = self.stamp(stamp_ns + self.tolerance_ns)
            transform.header.frame_id = self.map_frame
            set_planar(transform.transform, self.core.map_from_odom)
            self.transforms.publish(self.kinds.TFMessage(transforms=[transform]))

    def warn(self, kind: str, text: str) -> None:
        """Warn, unless a warning of this kind was given shortly before."""
        now = time.monotonic()
        if now - self.warned.get(kind, -SILENCE) >= SILENCE:
            self.warned[kind] = now
            self.tell(text, warning=True)


def nanoseconds(stamp: Any) -> int:
    """A time of ROS 1 or 2 in nanoseconds.

    >>> nanoseconds(SimpleNamespace(sec=2, nanosec=5))
    2000000005
    """
    return int(stamp.to_nsec()) if hasattr(stamp, "to_nsec") else int(stamp.sec) * 10**9 + int(stamp.nanosec)
