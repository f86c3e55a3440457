"""Everything that is found in a folder, before tasks are suggested."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from sextant.chapters.localization.data.rosbag import MAGIC, METADATA, bag_summary
from sextant.data.file_kinds import RAW, not_decoded
from sextant.data.image_files import natural_key
from sextant.data.photo_files import FOUND_IN_FOLDERS, FolderWalk, reason_alone, walk_folder
from sextant.data.photos.header import PhotoHeader
from sextant.data.videos import VIDEOS, open_video
from sextant.errors import UserError
from sextant.tools.inspection.photos import CameraGroup
from sextant.tools.inspection.poses import FoundPoses
from sextant.tools.inspection.times import FolderOfPhotos

#: files that may contain poses, or facts about photos
TABLES = (".txt", ".csv", ".tum", ".kitti", ".json", ".bin")


@dataclass(frozen=True)
class FoundFiles:
    """Files below a folder, relative to it, in natural order; hidden ones are left out.

    Attributes:
        images, videos: images and videos, by their suffixes.
        tables: files that may contain poses.
        recordings: ROS bags: files of ROS 1, folders of ROS 2 or a file from there.
        others: number of files by any other suffix.
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
    folders = {file.parent for file in files if file.name == METADATA}
    bags = folders | {file for file in files if file.suffix.lower() in MAGIC and file.parent not in folders}
    known = {*images, *videos, *tables, *raw, *bags}
    others = Counter(file.suffix.lower() or file.name for file in files if file not in known)
    return FoundFiles(images, videos, tables, tuple(sorted(bags)), dict(others), unreadable, tuple(walked.links))


@dataclass(frozen=True)
class FoundVideo:
    """A video.

    Attributes:
        name: name of the file.
        frames: number of frames, as its header states.
        per_second: frames per second; 0 if the header does not state them.
        width, height: pixels.
    """

    name: str
    frames: int
    per_second: float
    width: int
    height: int


def found_video(path: Path, name: str) -> FoundVideo | str:
    """The video, or why it cannot be used; its first frame is decoded."""
    if not path.is_file():
        return "is a link to nothing"
    if path.stat().st_size == 0:
        return "is empty (0 bytes)"
    import cv2

    video = open_video(path)
    try:
        opened = video.isOpened()
        read, frame = video.read() if opened else (False, None)
        frames, per_second = int(video.get(cv2.CAP_PROP_FRAME_COUNT)), float(video.get(cv2.CAP_PROP_FPS))
    finally:
        video.release()
    size = f"({path.stat().st_size:,} bytes)"
    if not opened:
        return f"cannot be opened as a video {size}"
    if not read or frame is None or frames <= 0:
        return f"does not decode: its first frame cannot be read {size}"
    height, width = frame.shape[:2]
    return FoundVideo(name, frames, max(per_second, 0.0), width, height)


def read_recordings(folder: Path, files: Sequence[Path]) -> tuple[dict[Path, str], dict[str, str]]:
    """Summaries by recording, empty without ``rosbags``; and for recordings that cannot be read, the reason by name."""
    found: dict[Path, str] = {}
    unreadable: dict[str, str] = {}
    for file in files:
        path = folder / file
        if not path.is_dir() and (problem := _not_a_bag(path)):
            unreadable[file.as_posix()] = problem
            continue
        try:
            found[file] = bag_summary(path) if find_spec("rosbags") else ""
        except UserError as error:
            unreadable[file.as_posix()] = reason_alone(str(path), str(error))
    return found, unreadable


def _not_a_bag(path: Path) -> str:
    """Why a file cannot be a bag, by its first bytes; "" if it can."""
    if not path.exists():
        return "is a link to nothing"
    magic, what = MAGIC[path.suffix.lower()]
    try:
        with path.open("rb") as opened:
            head = opened.read(len(magic))
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if not head:
        return "is empty (0 bytes)"
    return "" if head == magic else f"is not {what}: it begins with {head!r}, not with {magic!r}"


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
        recordings: summaries of the ROS bags that can be read.
        poses: files of poses.
        odometry: tables of odometry, with their numbers of rows.
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
    recordings: dict[Path, str]
    poses: list[FoundPoses]
    odometry: dict[Path, int]
    unreadable: dict[str, str]
