"""A ROS 1 node that localizes a robot by its camera and odometry, and publishes map -> odom (REP 105).

    python3 examples/ros1_localizer.py _map:=outputs/runs/localization/<run> image:=/camera/image_raw

It needs rospy, and Sextant in the same Python, such as a virtual environment with system packages. Parameters and
topics are those of ``ros2_localizer.py``: ``_name:=value`` sets a parameter, ``topic:=/other`` another topic.
"""

from typing import Any

import rospy

from sextant.chapters.localization.ros_node import RosNode
from sextant.errors import UserError


class LocalizerNode(RosNode):
    """Passes messages to a robot localizer, and publishes what it reports."""

    def __init__(self) -> None:
        self.set_up(
            lambda name, default: rospy.get_param(f"~{name}", default),
            "_map:=<folder of a run or of a saved localizer>",
        )
        self.subscribers = [
            rospy.Subscriber(topic, kind, heard, queue_size=depth, buff_size=2**26)
            for topic, (kind, heard, depth) in self.topics().items()
        ]

    def publisher(self, topic: str, kind: Any, depth: int) -> Any:
        """A publisher."""
        return rospy.Publisher(topic, kind, queue_size=depth)

    def stamp(self, nanoseconds: int) -> Any:
        """A time as messages have it."""
        return rospy.Time(*divmod(nanoseconds, 10**9))

    def full_name(self, topic: str) -> str:
        """The name of a topic after remapping; of the node for an empty one."""
        return str(rospy.resolve_name(topic) if topic else rospy.get_name())

    def tell(self, text: str, *, warning: bool) -> None:
        """Write a line to the log."""
        (rospy.logwarn if warning else rospy.loginfo)("%s", text)


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
