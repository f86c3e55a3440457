"""The user's own places: a folder of images per traverse, placed by poses or by their order."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.atomic_files import file_sha256
from sextant.chapters.places.data.aligned import align_by_name, align_by_order, traverse_files
from sextant.chapters.places.data.decoded_images import ImageSize, Together, read_images
from sextant.chapters.places.data.gps_poses import gps_poses
from sextant.chapters.places.data.images import SPLITS, PlaceImages, Split
from sextant.chapters.places.data.pose_files import Pose, table_poses, utm_poses
from sextant.data.photo_files import images_below
from sextant.data.source import MissingDataError, first_folder
from sextant.errors import ArgumentError, problem_list
from sextant.ranges import checked
from sextant.tables import counted

Places = Literal["csv", "utm", "gps", "order", "name"]
#: traverses of a test that does not name any, map first
REFERENCE_AND_QUERY = {"reference": "reference", "query": "query"}


class _Entry(NamedTuple):
    traverse: int
    frame: int
    path: Path
    pose: Pose | None


class PlaceFolders:
    """Reference and query folders, or any number of traverses.

    How places are known:

    ========= ==========================================================================================================
    ``csv``   a table ``file,x,y[,heading]`` in each traverse's folder, or one in the folder around them all
    ``utm``   names ``@UTM_east@UTM_north@...`` as the VPR community writes them
    ``gps``   the EXIF blocks of the images, see :mod:`~sextant.chapters.places.data.gps_poses`
    ``name``  equal names of two traverses are one place
    ``order`` the i-th images of all traverses, by the natural order of their names, are one place
    ========= ==========================================================================================================

    Tables and names are described in :mod:`~sextant.chapters.places.data.pose_files`.

    Args:
        folder: the folder that contains the traverses, absolute, or relative to the working directory or one of the
            ``roots``.
        train: folder of each traverse below ``folder``, keyed by the name of its condition; None if there is no such
            split.
        val: likewise.
        test: likewise, the map first; None for the folders ``reference`` and ``query``.
        places: how places are known, see above.
        csv: file name of the tables.
        height: rows that images are stretched to.
        width: columns that images are stretched to.
        channels: 3 for colour, 1 for grey.
        skip_bad: leave out files that cannot be decoded, and for ``places=name`` those without a partner.
        allow_duplicates: allow files of equal content within a split, or shared with another split.
        name: of the dataset, in results; None for ``place_folders``.
        roots: further folders to search; decoded images are kept in the last.

    Raises:
        UserError: an argument is invalid.
    """

    @checked
    def __init__(
        self,
        folder: str,
        train: Mapping[str, str] | None = None,
        val: Mapping[str, str] | None = None,
        test: Mapping[str, str] | None = None,
        places: Places = "csv",
        csv: str = "poses.csv",
        height: int = 64,
        width: int = 96,
        channels: int = 3,
        skip_bad: bool = False,
        allow_duplicates: bool = False,
        name: str | None = None,
        roots: Sequence[Path | str] = (),
    ):
        self.name, self.places, self.csv = name or "place_folders", places, csv
        self.looked = [Path(folder).expanduser().absolute(), *(Path(root) / folder for root in roots)]
        self.cache = Path(roots[-1]) if roots else None
        self.splits: dict[Split, Mapping[str, str] | None] = {
            "train": train,
            "val": val,
            "test": test or REFERENCE_AND_QUERY,
        }
        self.size, self.skip_bad, self.allow_duplicates = ImageSize(height, width, channels), skip_bad, allow_duplicates

    @property
    def place_unit(self) -> Literal["m", "frames"]:
        """Metres if there are poses, frames if there is an order."""
        return "m" if self.places in ("csv", "utm", "gps") else "frames"

    @property
    def folder(self) -> Path:
        """The first of the searched paths that is a folder."""
        return first_folder(
            self.looked,
            "folder",
            "Give the folder around the traverses: folder=/path/to/places "
            "test='{reference: first, query: second}'. Without images of your own: dataset=town_seasons",
        )

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The names of a split's traverses.

        Raises:
            MissingDataError: there is no such split.
        """
        return tuple(self._traverses(split))

    def files(self, split: Split) -> list[Path]:
        """The images of a split, traverse by traverse; nothing is decoded.

        Raises:
            UserError: a folder is missing or empty, or traverses that should be aligned are not.
        """
        return [entry.path for entry in self._aligned(split)[0]]

    def fingerprint(self) -> str:
        """Hash of the names, contents and places of all images, of how they are split, and of their size."""
        entries = [
            [split, [[e.traverse, e.frame, e.path.name, file_sha256(e.path), e.pose] for e in self._entries(split)[0]]]
            for split in SPLITS
            if self.splits[split]
        ]
        conditions = [list(chosen or ()) for chosen in self.splits.values()]
        size = [self.size.height, self.size.width, self.size.channels]
        return hashlib.sha256(json.dumps([self.places, entries, conditions, size]).encode()).hexdigest()

    def read(self, split: Split) -> PlaceImages:
        """The images of a split, decoded the first time and memory-mapped from the cache afterwards.

        Raises:
            UserError: files or poses are missing, duplicated or cannot be read; the message names them.
        """
        entries, missing = self._entries(split)
        if not self.allow_duplicates:
            self._refuse_duplicates(split, [entry.path for entry in entries])
        decoded = read_images(
            [entry.path for entry in entries],
            self.size,
            self.cache,
            what=f"{split} images of dataset={self.name}",
            skip_bad=self.skip_bad,
            together=Together(f"dataset={self.name}", self._images_of_all_splits),
        )
        kept = [entries[i] for i in decoded.kept]
        conditions = self.conditions(split)
        traverse = np.array([entry.traverse for entry in kept], np.int64)
        for k, name in enumerate(conditions):
            if not np.any(traverse == k):
                raise ArgumentError(f"{split}.{name}: none of its images can be read", "Replace them.")
        position, heading = _columns([entry.pose for entry in kept if entry.pose is not None])
        return PlaceImages(
            decoded.images,
            traverse,
            conditions,
            np.array([entry.frame for entry in kept], np.int64),
            tuple(f"{conditions[entry.traverse]}/{entry.path.name}" for entry in kept),
            position,
            heading,
            aligned=self.place_unit == "frames",
            skipped=decoded.bad + tuple(f"{name} is missing" for name in missing),
        )

    def _images_of_all_splits(self) -> Iterator[Path]:
        chosen = [self.folder / folder for each in self.splits.values() for folder in (each or {}).values()]
        there = [folder.resolve() for folder in chosen if folder.is_dir()]
        return (path for folder in there for path in images_below(folder))

    def _traverses(self, split: Split) -> dict[str, Path]:
        """The folder of each traverse.

        Raises:
            MissingDataError: the split has none.
            UserError: another split has one of these folders.
        """
        chosen = self.splits[split]
        if not chosen:
            raise MissingDataError(
                f"{split} is null: dataset={self.name} has no {split} images",
                f"Name a folder for each traverse: {split}='{{reference: <folder>, query: <folder>}}'",
            )
        traverses = {name: self.folder / folder for name, folder in chosen.items()}
        others = [(other, name, folder) for other in SPLITS for name, folder in (self.splits[other] or {}).items()]
        for own, path in traverses.items():
            for other, name, folder in others:
                if other != split and _overlap(path.resolve(), (self.folder / folder).resolve()):
                    raise ArgumentError(
                        f"{split}.{own}={chosen[own]} and {other}.{name}={folder} have files in common",
                        "Splits must share no place: give each its own folders.",
                    )
        return traverses

    def _aligned(self, split: Split) -> tuple[list[_Entry], tuple[str, ...]]:
        """Images with their frames but without poses, and the missing frames."""
        traverses, key = self._traverses(split), split
        files = traverse_files(traverses, key)
        if self.places == "name":
            rides = align_by_name(files, traverses, key, skip_missing=self.skip_bad)
        elif self.places == "order":
            rides = align_by_order(files, key)
        else:
            return [_Entry(t, i, path, None) for t, name in enumerate(files) for i, path in enumerate(files[name])], ()
        entries = [_Entry(t, i, path, None) for t, name in enumerate(files) for i, path in rides.files[name].items()]
        return entries, tuple(name for _, name in rides.missing)

    def _entries(self, split: Split) -> tuple[list[_Entry], tuple[str, ...]]:
        """Images with their places, and the missing frames."""
        entries, missing = self._aligned(split)
        if self.place_unit == "frames":
            return entries, missing
        if self.places == "gps":
            poses = gps_poses([entry.path for entry in entries], split)
            return [entry._replace(pose=pose) for entry, pose in zip(entries, poses, strict=True)], missing
        placed: list[_Entry] = []
        for t, (name, folder) in enumerate(self._traverses(split).items()):
            own, key = [entry for entry in entries if entry.traverse == t], f"{split}.{name}"
            paths = [entry.path for entry in own]
            poses = (
                utm_poses(paths, key)
                if self.places == "utm"
                else table_poses(paths, folder, self._table(folder, key), key)
            )
            placed += [entry._replace(pose=pose) for entry, pose in zip(own, poses, strict=True)]
        return placed, missing

    def _refuse_duplicates(self, split: Split, paths: Sequence[Path]) -> None:
        """Raise a ``UserError`` that names files of equal content, within the split or shared with an earlier one.

        A query that is also in the map, or that was trained on, is found trivially.
        """
        earlier = [other for other in SPLITS[: SPLITS.index(split)] if self.splits[other]]
        first = {file_sha256(entry.path): entry.path for other in earlier for entry in self._aligned(other)[0]}
        double: list[str] = []
        for path in paths:
            digest = file_sha256(path)
            if digest in first:
                double.append(f"{self._told(first[digest])} = {self._told(path)}")
            else:
                first[digest] = path
        if double:
            raise ArgumentError(
                f"{split}: {counted(len(double), 'file is a duplicate', 'files are duplicates')} of "
                f"another\n{problem_list(double)}",
                "Remove one of each pair, or, if this is intended, allow_duplicates=true",
            )

    def _told(self, path: Path) -> str:
        """A file's name in messages: below the folder if it lies there."""
        around = self.folder.resolve()
        return (path.relative_to(around) if path.is_relative_to(around) else path).as_posix()

    def _table(self, folder: Path, key: str) -> Path:
        """The table of a traverse: in its folder, or else in the folder around all traverses."""
        for path in (folder / self.csv, self.folder / self.csv):
            if path.is_file():
                return path
        raise MissingDataError(
            f"{key}: neither {folder} nor {self.folder} has a table {self.csv}",
            "Write one with the columns file,x,y or file,x,y,heading, give its name (csv=...), "
            "or choose places=utm, name or order.",
        )


def _overlap(first: Path, second: Path) -> bool:
    """Whether two folders are the same, or one lies in the other."""
    return first == second or first in second.parents or second in first.parents


def _columns(poses: Sequence[Pose]) -> tuple[Float64[ndarray, "n 2"] | None, Float64[ndarray, "n"] | None]:
    """Positions, and headings with nan where unknown; each is None if no image has one."""
    if not poses:
        return None, None
    heading = np.array([np.nan if pose.heading_deg is None else pose.heading_deg for pose in poses])
    return np.array([(pose.x, pose.y) for pose in poses]), None if np.isnan(heading).all() else heading
