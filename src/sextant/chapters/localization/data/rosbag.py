"""Robot recordings: images and odometry of a ROS 1 or ROS 2 bag, read without ROS by the package ``rosbags``.

Messages are read by the definitions that come with ``rosbags``, never by those stored in a bag. Images are
``sensor_msgs/Image`` or ``sensor_msgs/CompressedImage``, odometry is ``nav_msgs/Odometry``: REP 105's base in its
odometry frame, x ahead. The camera is the first ``sensor_msgs/CameraInfo`` of the topic ``camera_info`` beside the
images. Times are those of the headers; if a header of the topic has none, or they do not increase, those of the
recording.
"""

import os
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.odometry_file import OdometryFile
from sextant.chapters.localization.data.pose_formats import LENGTH_TOLERANCE, pose_matrices, to_plane
from sextant.chapters.localization.data.ros_messages import RosCamera, camera_of, picture_of
from sextant.data.image_files import picture_bytes
from sextant.data.pixel_values import WhiteLevels
from sextant.data.videos import Frame, Size
from sextant.errors import ArgumentError, UserError, how_to_install
from sextant.tables import counted

#: suffix of a ROS 1 bag, the file that makes a folder a ROS 2 bag, and suffixes of what it holds
FIRST, METADATA, STORED = ".bag", "metadata.yaml", (".mcap", ".db3")
#: suffix -> first bytes of a bag of one file, and what it is
MAGIC = {
    FIRST: (b"#ROSBAG V2.0", "a ROS 1 bag"),
    ".mcap": (b"\x89MCAP0\r\n", "an MCAP file"),
    ".db3": (b"SQLite format 3\0", "a ROS 2 bag of SQLite"),
}
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
ODOMETRY = ("nav_msgs/msg/Odometry",)
CAMERA = ("sensor_msgs/msg/CameraInfo",)


def is_rosbag(path: Path) -> bool:
    """Whether a path is a bag by its name: a file of ROS 1, or a folder recorded by ROS 2 or a file from there."""
    return (path.suffix.lower() in MAGIC and path.is_file()) or os.path.isfile(path / METADATA)


@dataclass(frozen=True, eq=False)
class Bag:
    """Every ``every``-th image of a bag.

    Attributes:
        path: file or folder.
        topic: of the images.
        times_s: of the images, as read by :meth:`read`.
        odometry: from its odometry topic; None without one, if none of its poses can be used, or if it was not read.
        every: step from one image to the next.
        remarks: remarks on the odometry for the user.
        camera: of the images; None if none is recorded, or it cannot be used.
        camera_problem: why a recorded camera cannot be used.
    """

    path: Path
    topic: str
    times_s: Float64[ndarray, "n"]
    odometry: OdometryFile | None
    every: int = 1
    remarks: tuple[str, ...] = ()
    camera: RosCamera | None = None
    camera_problem: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Numbers of the images."""
        return tuple(f"image {number * self.every}" for number in range(len(self)))

    def __len__(self) -> int:
        return len(self.times_s)

    def read(self, size: Size | None) -> Iterator[Frame]:
        """Yield the images, stretched to a size or as they are; those that cannot be decoded are reported."""
        with _opened(self.path) as bag:
            levels = WhiteLevels([])
            for number, (kind, _, raw) in enumerate(bag.messages(self.topic)):
                if number % self.every:
                    continue
                name = f"image {number}"
                try:
                    picture = picture_of(bag.message(raw, kind), kind)
                    shape = size or (picture.height, picture.width, 3)
                    yield Frame(name, picture_bytes(picture, *shape, levels=levels))
                except Exception as error:  # decoders raise errors of any kind on damaged bytes
                    yield Frame(
                        name, None, f"cannot be decoded: {str(error).splitlines()[0] if str(error) else error!r}"
                    )


def open_rosbag(
    path: Path,
    image_topic: str | None = None,
    odometry_topic: str | None = None,
    every: int = 1,
    *,
    with_odometry: bool = True,
) -> Bag:
    """Open a bag and find its images, camera and odometry.

    Args:
        path: a file of ROS 1, or a folder of ROS 2 or an ``.mcap`` or ``.db3`` file from there.
        image_topic: topic of the images; by default the only one.
        odometry_topic: topic of the odometry; by default the only one.
        every: take every k-th image.
        with_odometry: False leaves the odometry unread, so that no topic of it need be chosen.

    Raises:
        UserError: the bag cannot be read, has no images, has several topics of which none was chosen, or the chosen
            odometry has no pose that can be used.
    """
    with _opened(path) as bag:
        images = _topic(bag, IMAGES, "image_topic", image_topic)
        if images is None:
            raise UserError(f"{path} has no images", f"Its topics: {bag.listed()}.")
        moves = _topic(bag, ODOMETRY, "odometry_topic", odometry_topic) if with_odometry else None
        times = _times([(stamp, taken) for _, _, taken, stamp in bag.stamps(images)])
        odometry, problem = (None, "") if moves is None else _odometry(bag, moves)
        camera, wrong = _camera(bag, images)
    if odometry is None and odometry_topic is not None:
        raise ArgumentError(f"odometry_topic={odometry_topic}: {problem}", "Leave it out, or give odometry=<table>.")
    return Bag(path, images, times[::every], odometry, every, (problem,) if problem else (), camera, wrong)


def bag_summary(path: Path) -> str:
    """Duration of a bag, the number and rate of messages of each topic of images or odometry, and the cameras.

    Raises:
        UserError: the bag cannot be read.
    """
    with _opened(path) as bag:
        seconds = bag.reader.duration * 1e-9
        counts = {
            (link.topic, kinds is IMAGES): sum(x.msgcount for x in bag.reader.connections if x.topic == link.topic)
            for link in bag.reader.connections
            for kinds in (IMAGES, ODOMETRY)
            if link.msgtype in kinds and link.msgcount
        }
        cameras = [
            f"camera of {topic}: {camera}"
            for topic, images in sorted(counts)
            if images and (camera := _camera(bag, topic)[0]) is not None
        ]
    told = [
        f"{topic} ({count:,} {'images' if images else 'odometry poses'}"
        + (f", {count / seconds:.3g} Hz)" if seconds > 0 else ")")
        for (topic, images), count in sorted(counts.items())
    ]
    return f"{seconds:,.1f} s; {', '.join([*told, *cameras]) or 'neither images nor odometry'}"


class _Opened:
    """A reader for either version, and the messages that it finds."""

    def __init__(self, path: Path):
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore

        first = path.is_file() and path.suffix.lower() not in STORED
        types = get_typestore(Stores.ROS1_NOETIC if first else Stores.LATEST)
        self.reader: Any = (rosbag1 if first else rosbag2).Reader(path)
        self.message: Callable[[bytes, str], Any] = types.deserialize_ros1 if first else types.deserialize_cdr
        self._first = first

    def topics(self, kinds: tuple[str, ...]) -> list[str]:
        """Topics with messages of the given types."""
        found = [link.topic for link in self.reader.connections if link.msgtype in kinds and link.msgcount]
        return sorted(dict.fromkeys(found))

    def listed(self) -> str:
        """All topics, with their types."""
        return ", ".join(sorted(f"{link.topic} ({link.msgtype})" for link in self.reader.connections)) or "none"

    def messages(self, topic: str) -> Iterator[tuple[str, float, bytes]]:
        """Type, recording time in seconds, and bytes of each message."""
        links = [link for link in self.reader.connections if link.topic == topic]
        for link, taken, raw in self.reader.messages(connections=links):
            yield link.msgtype, taken * 1e-9, raw

    def stamps(self, topic: str) -> Iterator[tuple[str, bytes, float, float]]:
        """Type, bytes, and times in seconds of the recording and of the header, of each message; nothing is decoded."""
        for kind, taken, raw in self.messages(topic):
            order = "<" if self._first or raw[1] & 1 else ">"
            seconds, nanoseconds = struct.unpack_from(f"{order}II", raw, 4)  # after seq, or after CDR's own header
            yield kind, raw, taken, seconds + nanoseconds * 1e-9


@contextmanager
def _opened(path: Path) -> Iterator[_Opened]:
    if find_spec("rosbags") is None:
        raise UserError(f"{path}: a ROS bag needs rosbags, which is not installed", how_to_install("ros"))
    try:
        bag = _Opened(path)
        with bag.reader:
            yield bag
    except UserError:
        raise
    except Exception as error:  # the readers raise their own errors, and those of sqlite and YAML
        told = str(error).splitlines()[0] if str(error) else repr(error)
        raise UserError(f"{path} cannot be read as a ROS bag: {told}", _remedy(path)) from None


def _remedy(path: Path) -> str:
    """What to do about a bag that cannot be read, by what it holds."""
    if path.is_dir():
        if any(file.suffix in STORED for file in path.iterdir()):
            return f"If its recording was not ended: ros2 bag reindex {path}"
        return f"A ROS 2 bag is a folder with {METADATA} and a .db3 or .mcap file, which {path} lacks."
    magic, what = MAGIC.get(path.suffix.lower(), MAGIC[FIRST])
    with path.open("rb") as file:
        head = file.read(len(magic))
    if head != magic:
        return f"It begins with {head!r}, but {what} begins with {magic!r}: give the bag itself."
    if path.suffix.lower() in STORED:
        return "It must be written by ROS 2, in CDR. If its recording was not ended: ros2 bag reindex <its folder>"
    return f"If its recording was not ended: rosbag reindex {path}"


def _camera(bag: _Opened, topic: str) -> tuple[RosCamera | None, str]:
    """The camera of a topic, by ``camera_info`` beside it or the only such topic, and what is wrong with it."""
    there = bag.topics(CAMERA)
    base = topic.removesuffix("/compressed")
    beside = [f"{base.rpartition('/')[0]}/camera_info", f"{base}/camera_info"]
    chosen = next((each for each in beside if each in there), there[0] if len(there) == 1 else None)
    if chosen is None:
        return None, ""
    kind, _, raw = next(bag.messages(chosen))
    try:
        camera = camera_of(bag.message(raw, kind), base)
    except UserError as error:
        return None, error.problem
    return camera, "" if camera else f"{chosen} is of a camera that is not calibrated: its matrix K is zero"


def _topic(bag: _Opened, kinds: tuple[str, ...], argument: str, chosen: str | None) -> str | None:
    there = bag.topics(kinds)
    if chosen is None:
        if len(there) > 1:
            raise ArgumentError(f"{argument}= is missing: there are {', '.join(there)}", f"{argument}={there[0]}")
        return there[0] if there else None
    if chosen not in there:
        raise ArgumentError(
            f"{argument}={chosen} has no messages of type {' or '.join(kinds)}",
            f"Topics with such messages: {', '.join(there) or 'none'}.",
        )
    return chosen


def _times(found: list[tuple[float, float]]) -> Float64[ndarray, "n"]:
    """The times of the headers, if all have one and they increase; otherwise those of the recording."""
    stamps, taken = np.array(found, np.float64).reshape(-1, 2).T
    rise = (stamps > 0).all() and (np.diff(stamps) > 0).all()
    return np.ascontiguousarray(stamps if rise else np.maximum.accumulate(taken))


def _odometry(bag: _Opened, topic: str) -> tuple[OdometryFile | None, str]:
    """The poses of a topic that can be used, and what is wrong with the others."""
    rows = [(bag.message(raw, kind).pose.pose, (stamp, taken)) for kind, raw, taken, stamp in bag.stamps(topic)]
    found, times = [pose for pose, _ in rows], _times([seconds for _, seconds in rows])
    position = np.array([(p.position.x, p.position.y, p.position.z) for p in found])
    turned = np.array([(p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w) for p in found])
    length = np.linalg.norm(turned, axis=1)
    posed = np.isfinite(position).all(axis=1) & (np.abs(length - 1) < LENGTH_TOLERANCE)
    fine = posed & np.concatenate([[True], np.diff(times) > 0])
    problem = ""
    if not posed.all():
        bad = int(np.flatnonzero(~posed)[0])
        problem = (
            f"odometry of {topic}: {int((~posed).sum()):,} of {counted(len(posed), 'pose')} cannot be used, such as "
            f"number {bad + 1}, whose orientation is a quaternion of length {length[bad]:.3g}, not 1, or not finite"
        )
    if not fine.any():
        return None, f"{problem}: motion is unknown"
    poses = to_plane(pose_matrices(position[fine], turned[fine]), "xy", "x", f"odometry of {topic}")
    return OdometryFile(poses, times[fine]), problem
