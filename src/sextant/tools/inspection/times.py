"""When photos were taken, and whether their names are in that order."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from sextant.chapters.localization.data.pose_times import times_of_names
from sextant.data.image_files import natural_key
from sextant.data.photos.header import PhotoHeader

#: a step in time is a jump if it is this many times the usual one, and longer than this many seconds
JUMP, JUMP_S = 10.0, 5.0


@dataclass(frozen=True)
class FolderOfPhotos:
    """The photos of one folder, in the natural order of their names.

    Attributes:
        folder: the folder, relative to the one that is inspected.
        files: its photos, also relative to the inspected folder.
        times_from: source of the times at which photos were taken; None if there is none for all of them.
        times_s: time of each in seconds, or None.
        jumps: names of photos after an unusually long gap in time, with that gap in seconds.
        backwards: names of photos that were taken before the preceding one.
        same_stem: names that differ from another only in their suffix or in case.
    """

    folder: Path
    files: tuple[Path, ...]
    times_from: Literal["EXIF", "names"] | None
    times_s: tuple[float, ...] | None
    jumps: tuple[tuple[str, float], ...]
    backwards: tuple[str, ...]
    same_stem: tuple[str, ...]


def folders_of_photos(headers: Mapping[Path, PhotoHeader]) -> list[FolderOfPhotos]:
    """The folders that contain photos, each with the order of its photos in time."""
    by_folder: dict[Path, list[Path]] = {}
    for file in headers:
        by_folder.setdefault(file.parent, []).append(file)
    return [_folder(folder, files, headers) for folder, files in by_folder.items()]


def _folder(folder: Path, files: list[Path], headers: Mapping[Path, PhotoHeader]) -> FolderOfPhotos:
    files = sorted(files, key=lambda file: natural_key(file.name))
    named = times_of_names(files)
    source, times = ("names", named) if named is not None else _exif_times(files, headers)
    jumps: list[tuple[str, float]] = []
    backwards: list[str] = []
    if times is not None and len(times) > 1:
        steps = np.diff(times)
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        jumps = [
            (files[i + 1].name, float(steps[i])) for i in np.flatnonzero(steps > max(JUMP * usual, JUMP_S)).tolist()
        ]
        backwards = [files[i + 1].name for i in np.flatnonzero(steps < 0).tolist()]
    stems = Counter(file.stem.lower() for file in files)
    twice = tuple(file.name for file in files if stems[file.stem.lower()] > 1)
    return FolderOfPhotos(
        folder, tuple(files), None if times is None else source, None if times is None else tuple(times.tolist()),
        tuple(jumps), tuple(backwards), twice,
    )  # fmt: skip


def _exif_times(
    files: Sequence[Path], headers: Mapping[Path, PhotoHeader]
) -> tuple[Literal["EXIF", "names"], np.ndarray | None]:
    taken = [headers[file].taken_s for file in files]
    return "EXIF", None if None in taken else np.array(taken, np.float64)
