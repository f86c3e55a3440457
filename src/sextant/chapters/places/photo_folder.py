"""The photos of a map or of queries; does not import torch."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sextant.data.photo_files import find_photos
from sextant.errors import ArgumentError
from sextant.user_files import absent

#: file that a folder of descriptors contains; see :mod:`~sextant.chapters.places.saved_map`
HEADER = "map.json"

#: source of the ground truth, i.e. which photos of two folders show the same place: none, a table of poses, poses in
#: their names or in EXIF, equal names, or their order
KnownBy = Literal["none", "csv", "utm", "gps", "name", "order"]


@dataclass(frozen=True)
class PhotoFolder:
    """Photos of a folder.

    Attributes:
        folder: folder that the names are relative to.
        names: names of the files in natural order: ``image2`` before ``image10``.
    """

    folder: Path
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def paths(self) -> list[Path]:
        """The files."""
        return [self.folder / name for name in self.names]


def photo_folder(photos: PhotoFolder | Path | str | Iterable[Path | str]) -> PhotoFolder:
    """Photos of the photo or folder at a path, or files in the given order, with names relative to one absolute folder.

    A :class:`PhotoFolder` is returned as it is.

    Raises:
        ArgumentError: there are none, or they are not files.
    """
    if isinstance(photos, PhotoFolder):
        return photos
    if isinstance(photos, Path | str):
        found = photos_below(photos)
        return PhotoFolder(found.folder.absolute(), found.names)
    photos = list(photos) if isinstance(photos, Iterable) else [photos]
    if wrong := [type(photo).__name__ for photo in photos if not isinstance(photo, Path | str)]:
        raise ArgumentError(
            f"photos: a map keeps the names of files, and a value of type {wrong[0]} is not a file",
            "Give files, or a folder of photos; write pictures and arrays to files first.",
        )
    paths = [Path(os.path.abspath(Path(path).expanduser())) for path in photos]
    if not paths:
        raise ArgumentError("photos=[]: there is no photo", "Give files, or a folder of photos.")
    folder = Path(os.path.commonpath([path.parent for path in paths]))
    return PhotoFolder(folder, tuple(path.relative_to(folder).as_posix() for path in paths))


def photos_below(
    given: Path | str, key: str = "photos", output: Path | None = None, *, one: bool = True
) -> PhotoFolder:
    """The photos below a folder, or a single photo where that is allowed.

    Args:
        given: folder or photo.
        key: name of the argument, for error messages.
        output: folder of results, whose images are not counted as photos.
        one: allow a single photo.

    Raises:
        ArgumentError: there is no such folder, or no photo in it.
    """
    path = Path(given).expanduser()
    if path.is_file() and one:
        return PhotoFolder(path.parent, (path.name,))
    if not path.is_dir():
        what = f"{given}: is a file, not a folder" if path.is_file() else absent(path)
        raise ArgumentError(f"{key}={what}", f"Give a folder of photos: {key}=/path/to/photos")
    from sextant.data.image_files import natural_key

    names = [found.relative_to(path).as_posix() for found in find_photos(str(path), output, key)]
    return PhotoFolder(path, tuple(sorted(names, key=natural_key)))
