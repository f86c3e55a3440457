"""All that is seen in a folder, before anything is suggested."""

from dataclasses import dataclass
from pathlib import Path

from sextant.applications.inspection.files import FoundFiles
from sextant.applications.inspection.photos import CameraGroup
from sextant.applications.inspection.poses import FoundPoses
from sextant.applications.inspection.times import FolderOfPhotos
from sextant.applications.inspection.videos import FoundVideo
from sextant.data.photos.header import PhotoHeader


@dataclass(frozen=True, eq=False)
class Seen:
    """What a folder holds. All paths are relative to it.

    Attributes:
        given: the folder, or the one file, as the user named it.
        folder: the folder; of one file, the folder around it.
        files: below it, by what they may be.
        headers: of the images that can be read.
        cameras: of all of them, the most frequent first.
        folders: that images lie in, and their order in time.
        panoramas: images of 360 degrees.
        duplicates: images of equal content.
        videos: that decode.
        poses: files of poses.
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
    unreadable: dict[str, str]
