"""The user's own drive: its images in order, and the robot's motion between them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.camera import Camera, find_camera
from sextant.chapters.localization.data.frames import Photos, find_frames
from sextant.chapters.localization.data.odometry_file import motions_of, read_odometry
from sextant.chapters.localization.data.rosbag import Bag, is_rosbag, open_rosbag
from sextant.data.file_kinds import is_hidden
from sextant.data.photo_files import FOUND_IN_FOLDERS, images_below
from sextant.data.videos import VIDEOS, Frame, Video
from sextant.errors import ArgumentError, UserError

NO_ODOMETRY = "no odometry= was given: the motion between images is unknown"


@dataclass(frozen=True, eq=False)
class OwnDrive:
    """Images in their order.

    Attributes:
        frames: the images.
        motions: dx, dy, dtheta from the previous image, in the robot's frame there; None where unknown. Empty for a
            camera, whose number of images is unknown.
        times_s: time of each image in seconds: from names, video or bag, from the odometry, or its number.
        remarks: remarks for the user.
    """

    frames: Photos | Video | Bag | Camera
    motions: list[Float64[ndarray, "3"] | None]
    times_s: Float64[ndarray, "n"]
    remarks: list[str]

    def __len__(self) -> int:
        """Number of images; 0 for a camera, which is endless."""
        return len(self.motions)

    @property
    def endless(self) -> bool:
        """Whether the images come from a camera."""
        return isinstance(self.frames, Camera)

    def with_motions(self, frames: Iterable[Frame]) -> Iterator[tuple[Frame, Float64[ndarray, "3"] | None]]:
        """Each image of the drive, as it arrives, with the motion since the previous one."""
        if isinstance(self.frames, Camera):
            return zip(frames, repeat(None), strict=False)
        return zip(frames, self.motions, strict=True)

    def times_of(self, count: int) -> Float64[ndarray, "count"]:
        """The times of the first images, once they have arrived."""
        return self.frames.times_s[:count] if isinstance(self.frames, Camera) else self.times_s[:count]


def open_drive(
    given: str,
    odometry: Path | None,
    output: Path,
    *,
    every: int = 1,
    image_topic: str | None = None,
    odometry_topic: str | None = None,
) -> OwnDrive:
    """Find images and their odometry.

    Args:
        given: a folder of photos, a video, ``camera:0``, or a ROS bag, whose own odometry is used unless a file is
            given.
        odometry: a trajectory in TUM format or a table.
        output: folder of the results, which are not read as photos.
        every: take every k-th image of a video, a bag or a camera.
        image_topic: image topic of a bag; by default its only one.
        odometry_topic: odometry topic of a bag; by default its only one.

    Raises:
        UserError: there are no images, or the odometry does not match them.
    """
    if (camera := find_camera(given, every)) is not None:
        for key, value in (("odometry", odometry), ("image_topic", image_topic), ("odometry_topic", odometry_topic)):
            if value is not None:
                raise ArgumentError(f"{key}={value} does not go with input={given}, a camera", f"Leave out {key}=.")
        return OwnDrive(camera, [], np.zeros(0), [NO_ODOMETRY])
    frames = find_images(
        given, output, every, image_topic, odometry_topic, with_odometry=odometry is None or odometry_topic is not None
    )
    motions: list[Float64[ndarray, "3"] | None]
    moves, named = frames.odometry if isinstance(frames, Bag) else None, Path(given).expanduser()
    if odometry is not None:
        moves, named = read_odometry(odometry), odometry
        if moves.names is not None and isinstance(frames, Photos):
            frames = frames.in_order_of(moves.names, odometry)
    told = list(frames.remarks) if isinstance(frames, Bag) and odometry is None else []
    if moves is None:
        motions, remarks = [None] * len(frames), told or [NO_ODOMETRY]
    else:
        count = frames.frames if isinstance(frames, Video) else None
        motions, remarks = motions_of(moves, frames.names, frames.times_s, named, every, count)
        remarks = [*told, *remarks]
    if isinstance(frames, Bag) and (camera_told := frames.camera or frames.camera_problem):
        remarks = [*remarks, f"camera of {frames.topic}, whose images are used as they are: {camera_told}"]
    times = frames.times_s
    if times is None and moves is not None and moves.times_s is not None and len(moves.times_s) == len(frames):
        times = moves.times_s
    return OwnDrive(frames, motions, np.arange(len(frames), dtype=np.float64) if times is None else times, remarks)


def find_images(
    given: str,
    output: Path,
    every: int,
    image_topic: str | None = None,
    odometry_topic: str | None = None,
    *,
    with_odometry: bool = True,
) -> Photos | Video | Bag:
    """The photos, the video or the ROS bag that ``input=`` names.

    Arguments as for :func:`open_drive`, and ``with_odometry`` as for :func:`open_rosbag`.

    Raises:
        UserError: there are no images, or a topic is given and it is no bag.
    """
    path = Path(given).expanduser()
    if is_rosbag(path):
        return open_rosbag(path, image_topic, odometry_topic, every, with_odometry=with_odometry)
    for key, topic in (("image_topic", image_topic), ("odometry_topic", odometry_topic)):
        if topic is not None:
            raise ArgumentError(f"{key}={topic} is for a ROS bag; input={given} is not one", f"Leave out {key}=.")
    there = [each for each in path.glob("*") if not is_hidden(each.name)]
    streams = [each for each in there if is_rosbag(each) or each.suffix.lower() in VIDEOS]
    if streams and not images_below(path) and not any(each.suffix.lower() in FOUND_IN_FOLDERS for each in there):
        raise UserError(f"input={given}: no photo there, but {min(streams).name}", f"input={min(streams)}")
    return find_frames(given, output, every)
