"""Folders whose photos all have a GPS position: drives without a file of poses."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sextant.chapters.places.data.gps_poses import local_poses
from sextant.data.photos.gps import GpsPosition
from sextant.data.photos.header import PhotoHeader
from sextant.tools.inspection.poses import FoundPoses
from sextant.tools.inspection.times import FolderOfPhotos

#: largest distance in metres between the grounds of two drives through the same places
APART_M = 50.0


def positions(headers: Mapping[Path, PhotoHeader], folder: Path | None = None) -> list[GpsPosition]:
    """Positions of all photos, or of those directly in a folder."""
    chosen = (each.gps.position for file, each in headers.items() if folder is None or file.parent == folder)
    return [position for position in chosen if position is not None]


def poses_by_gps(headers: Mapping[Path, PhotoHeader], folders: Sequence[FolderOfPhotos]) -> list[FoundPoses]:
    """The poses of each folder of at least two photos that all have a position."""
    drives = {each.folder: len(each.files) for each in folders}
    return [
        FoundPoses(folder, "gps", count, folder, count)
        for folder, count in drives.items()
        if count >= 2 and len(positions(headers, folder)) == count
    ]


def extent_m(found: Sequence[GpsPosition]) -> tuple[float, float]:
    """Extent in metres from west to east and from south to north."""
    east, north = np.ptp([(pose.x, pose.y) for pose in local_poses(found)], axis=0)
    return float(east), float(north)


def same_ground(one: Sequence[GpsPosition], other: Sequence[GpsPosition]) -> bool:
    """Whether the bounding boxes of two drives come within :data:`APART_M` of each other."""
    places = np.array([(pose.x, pose.y) for pose in local_poses([*one, *other])])
    first, second = places[: len(one)], places[len(one) :]
    return bool(((first.max(0) + APART_M >= second.min(0)) & (second.max(0) + APART_M >= first.min(0))).all())
