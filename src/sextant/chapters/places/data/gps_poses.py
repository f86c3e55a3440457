r"""Where images were taken, from GPS in their EXIF blocks: metres in a local frame, x to the east and y to the north.

Geocentric positions (`sextant.data.geodesy`) relative to the first image are resolved along its axes east, north and
up; only east and north are kept. Heights are those of the EXIF block, 0 if it has none.

A heading is the viewing direction in the block, taken as relative to true north even if it is a compass direction. If
images lack it, headings are those of the course from image to image, which assumes that the camera faces ahead.
"""

import logging
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.places.data.pose_files import Pose
from sextant.data.geodesy import geocentric, local_axes
from sextant.errors import ArgumentError, problem_list
from sextant.tables import counted

if TYPE_CHECKING:
    from sextant.data.photos.gps import GpsPosition

log = logging.getLogger(__name__)

#: metres between images from which a heading is derived: about the accuracy of GPS
STEP_M = 3.0


def gps_poses(paths: Sequence[Path], key: str, notes: list[str] | None = None) -> list[Pose]:
    """Poses of images in the frame of the first; those without a direction have no heading.

    Args:
        paths: of the images.
        key: of the argument that names them, for messages.
        notes: receives the assumptions about doubtful positions; None logs them.

    Raises:
        ArgumentError: images have no position; the message names them, each with the reason.
    """
    doubts: list[str] = []
    poses = local_poses(_positions(paths, key, doubts))
    if notes is None:
        for doubt in doubts:
            log.warning(doubt)
    else:
        notes += doubts
    return poses


def _positions(paths: Sequence[Path], key: str, notes: list[str]) -> "list[GpsPosition]":
    from sextant.data.photos.gps import photo_gps  # whose package imports torch

    found = [(path.name, *photo_gps(path)) for path in paths]
    if without := [f"{name}{problem and ': '}{problem}" for name, position, problem in found if position is None]:
        raise ArgumentError(
            f"{key}: {len(without):,} of {counted(len(paths), 'image')} {'has' if len(without) == 1 else 'have'} no "
            f"GPS position in EXIF\n{problem_list(without)}",
            "Move these images out of the folder, or give positions in a table: file,x,y,heading.",
        )
    notes += [f"{key}: {doubt}" for doubt in doubtful({name: problem for name, _, problem in found})]
    return [position for _, position, _ in found if position is not None]


def doubtful(problems: Mapping[str, str], what: str = "doubtful") -> list[str]:
    """Doubts about positions by image name, one line per kind of doubt; ``what`` describes the positions."""
    kinds: dict[str, list[str]] = {}
    for name, problem in problems.items():
        if problem:
            kinds.setdefault(re.sub(r"-?\d[\d.,e+ -]*\d|\d", "#", problem), []).append(name)
    return [
        f"the positions of {len(names):,} of {counted(len(problems), 'image')} are {what}, such as {names[0]}: "
        f"{problems[names[0]]}"
        for names in kinds.values()
    ]


def local_poses(positions: "Sequence[GpsPosition]") -> list[Pose]:
    """Poses in the frame of the first position; headings are degrees counter-clockwise from the east of that frame.

    Example:
        >>> from sextant.data.photos.gps import GpsPosition
        >>> first, second = local_poses([GpsPosition(55.7, 13.2, None, 90.0), GpsPosition(55.701, 13.2, None)])
        >>> round(second.y, 1), round(first.heading_deg), second.heading_deg
        (111.3, 0, None)
    """
    values = [(each.latitude_deg, each.longitude_deg, each.altitude_m or 0.0) for each in positions]
    latitude, longitude, height = np.array(values, np.float64).reshape(-1, 3).T
    latitude, longitude = np.radians(latitude), np.radians(longitude)
    axes, places = local_axes(latitude, longitude), geocentric(latitude, longitude, height)
    x, y, _ = axes[0] @ (places - places[0]).T
    direction = np.radians([np.nan if each.direction_deg is None else each.direction_deg for each in positions])
    looks = np.sin(direction)[:, None] * axes[:, 0] + np.cos(direction)[:, None] * axes[:, 1]
    to_east, to_north, _ = axes[0] @ looks.T
    headings = np.degrees(np.arctan2(to_north, to_east))
    rows = zip(x.tolist(), y.tolist(), headings.tolist(), strict=True)
    return [Pose(east, north, None if math.isnan(heading) else heading) for east, north, heading in rows]


def drive_by_gps(paths: Sequence[Path], first: Path, key: str, notes: list[str]) -> Float64[ndarray, "n 3"]:
    """x, y and heading in radians of the images of a drive, in the frame of a given image.

    Args:
        paths: of the images, in the order of the drive.
        first: the image whose position is the origin.
        key: as for :func:`gps_poses`.
        notes: receives a note if headings are those of the course, and the assumptions about doubtful positions.

    Raises:
        ArgumentError: images have no position, or no direction and the drive does not move.
    """
    positions = _positions(paths, key, notes)
    rows = local_poses([*_positions([first], key, []), *positions])[1:]
    places = np.array([(row.x, row.y) for row in rows])
    headings = [row.heading_deg for row in rows if row.heading_deg is not None]
    if len(headings) == len(rows):
        return np.column_stack([places, np.radians(headings)])
    lacking = (
        f"{key}: {len(rows) - len(headings):,} of {counted(len(rows), 'image')} "
        f"{'has' if len(rows) - len(headings) == 1 else 'have'} no viewing direction in EXIF"
    )
    course = course_deg(places)
    if course is None:
        raise ArgumentError(f"{lacking}, and they lie within {STEP_M:g} m", "Give a table: file,x,y,heading.")
    notes.append(f"{lacking}: all headings are those of the course, assuming that the camera faces ahead")
    return np.column_stack([places, np.radians(course)])


def course_deg(positions: Float64[ndarray, "n 2"]) -> Float64[ndarray, "n"] | None:
    """Course along positions, in degrees counter-clockwise from x; None if they never move.

    At positions every 3 m, it is the direction from the previous to the next of these; in between, it is interpolated.
    """
    kept = [0]
    for i, place in enumerate(positions):
        if np.hypot(*(place - positions[kept[-1]])) >= STEP_M:
            kept.append(i)
    if len(kept) < 2:
        return None
    along = np.gradient(positions[kept], axis=0)
    headings = np.degrees(np.unwrap(np.arctan2(along[:, 1], along[:, 0])))
    return np.asarray(np.interp(np.arange(len(positions)), kept, headings))
