"""Everything that is seen in a folder, before anything is suggested."""

from dataclasses import dataclass
from pathlib import Path

from sextant.data.photos.header import PhotoHeader
from sextant.tools.inspection.files import FoundFiles
from sextant.tools.inspection.photos import CameraGroup
from sextant.tools.inspection.poses import FoundPoses
from sextant.tools.inspection.times import FolderOfPhotos
from sextant.tools.inspection.videos import FoundVideo


@dataclass(frozen=True, eq=False)
class Seen:
    """The contents of a folder. All paths are relative to it.

    Attributes:
        given: the folder, or the single file, as the user named it.
        folder: the folder; for a single file, the folder around it.
        files: files below it, by what they may be.
        headers: headers of the images that can be read.
        cameras: cameras of these images, the most frequent first.
        folders: folders that contain images, with the order of these in time.
        panoramas: 360-degree images.
        duplicates: images with equal content.
        videos: videos that can be decoded.
        poses: files of poses.
        odometry: tables of odometry, with how many rows they have.
        unreadable: reasons by name.
    """

    given: Path
    folder: Path
    files: FoundFiles
    headers: dict[Path, PhotoHeader]
    cameras: list[CameraGroup]
    folders: list[FolderOfPhotos]
    panoramas: list[Path]
    duplicates: list[tuple[str, ...]]
    videos: list[FoundVideo]
    poses: list[FoundPoses]
    odometry: dict[Path, int]
    unreadable: dict[str, str]
