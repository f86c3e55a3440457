"""A drive of the user's own: its images one after the other, and how the robot moved between them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.data.localization.frames import Photos, Video, find_frames
from sextant.data.localization.odometry_file import motions_of, read_odometry
from sextant.data.localization.rosbag import Bag, is_rosbag, open_rosbag
from sextant.errors import ArgumentError


@dataclass(frozen=True, eq=False)
class OwnDrive:
    """Images in their order.

    Attributes:
        frames: the images.
        motions: dx, dy, dtheta from the image before, in the robot's frame there; None where it is not known.
        times_s: seconds of each image: by names, video or bag, by the odometry, or counted.
        remarks: what the user should know.
    """

    frames: Photos | Video | Bag
    motions: list[Float64[ndarray, "3"] | None]
    times_s: Float64[ndarray, "n"]
    remarks: list[str]


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
        given: a folder of photos, a video, or a ROS bag, whose own odometry is used unless a file is named.
        odometry: a trajectory in TUM's format or a table.
        output: folder of the results, none of which is taken for a photo.
        every: of a video or a bag, take one of so many images.
        image_topic: of a bag; its only one unless given.
        odometry_topic: of a bag; its only one unless given.

    Raises:
        UserError: there is no image, or the odometry does not go with them.
    """
    path = Path(given).expanduser()
    frames: Photos | Video | Bag
    motions: list[Float64[ndarray, "3"] | None]
    if is_rosbag(path):
        frames = open_rosbag(path, image_topic, odometry_topic, every)
        moves, named = frames.odometry, path
    else:
        for key, topic in (("image_topic", image_topic), ("odometry_topic", odometry_topic)):
            if topic is not None:
                raise ArgumentError(f"{key}={topic} is of a ROS bag; input={given} is none", f"Leave out {key}=.")
        frames, moves, named = find_frames(given, output, every), None, path
    if odometry is not None:
        moves, named = read_odometry(odometry), odometry
        if moves.names is not None and isinstance(frames, Photos):
            frames = frames.in_order_of(moves.names, odometry)
    if moves is None:
        told = "no odometry= was given: between images the particles spread as where odometry is lost"
        motions, remarks = [None] * len(frames), [told]
    else:
        count = frames.frames if isinstance(frames, Video) else None
        motions, remarks = motions_of(moves, frames.names, frames.times_s, named, every, count)
    times = frames.times_s
    if times is None and moves is not None and moves.times_s is not None and len(moves.times_s) == len(frames):
        times = moves.times_s
    return OwnDrive(frames, motions, np.arange(len(frames), dtype=np.float64) if times is None else times, remarks)
