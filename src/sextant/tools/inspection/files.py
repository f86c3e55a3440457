"""The files below a folder, by what they may be."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from sextant.chapters.localization.data.frames import VIDEOS
from sextant.chapters.localization.data.rosbag import FIRST, METADATA
from sextant.data.file_kinds import RAW, not_decoded
from sextant.data.image_files import natural_key
from sextant.data.photo_files import FOUND_IN_FOLDERS, FolderWalk, walk_folder

#: files that may contain poses, or facts about photos
TABLES = (".txt", ".csv", ".tum", ".kitti", ".json", ".bin")


@dataclass(frozen=True)
class FoundFiles:
    """Files below a folder, relative to it, in natural order; hidden ones are left out.

    Attributes:
        images, videos: images and videos, by their suffixes.
        tables: files that may contain poses.
        recordings: ROS bags: files of ROS 1, folders of ROS 2.
        others: how many there are of each other suffix.
        unreadable: reasons by file or folder.
        links: links to folders, which are not followed.
    """

    images: tuple[Path, ...]
    videos: tuple[Path, ...]
    tables: tuple[Path, ...]
    recordings: tuple[Path, ...]
    others: dict[str, int]
    unreadable: dict[str, str]
    links: tuple[Path, ...]


def found_files(path: Path) -> FoundFiles:
    """List a folder recursively, or one file. Links to folders are not followed, since they may be circular."""
    walked = walk_folder(path) if path.is_dir() else FolderWalk(path.parent, [Path(path.name)])
    files, unreadable = sorted(walked.files, key=lambda file: natural_key(file.as_posix())), walked.unreadable
    kinds = (FOUND_IN_FOLDERS, VIDEOS, TABLES, RAW)
    images, videos, tables, raw = (tuple(file for file in files if file.suffix.lower() in kind) for kind in kinds)
    for file in raw:
        unreadable[file.as_posix()] = str(not_decoded(walked.folder / file))
    bags = {
        file.parent if file.name == METADATA else file
        for file in files
        if file.name == METADATA or file.suffix.lower() == FIRST
    }
    known = {*images, *videos, *tables, *raw, *bags}
    others = Counter(file.suffix.lower() or file.name for file in files if file not in known)
    return FoundFiles(images, videos, tables, tuple(sorted(bags)), dict(others), unreadable, tuple(walked.links))
