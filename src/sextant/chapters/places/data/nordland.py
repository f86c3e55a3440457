"""Nordland: one railway line filmed in several seasons, frame-aligned; or any other traverses with a folder per season.

Source: N. Sünderhauf, P. Neubert, P. Protzel, "Are we there yet? Challenging SeqSLAM on a 3000 km journey across all
four seasons", ICRA Workshop on Long-Term Autonomy, 2013. Filmed by NRK.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from sextant.atomic_files import file_sha256
from sextant.chapters.places.data.aligned import AlignedRides, align_by_name, traverse_files
from sextant.chapters.places.data.decoded_images import ImageSize, Together, read_images
from sextant.chapters.places.data.images import SPLITS, PlaceImages, Split
from sextant.chapters.places.data.splits import FrameRanges
from sextant.data.file_kinds import is_hidden
from sextant.data.source import MissingDataError, first_folder
from sextant.errors import ArgumentError


class Nordland:
    """Frames in ``nordland/<season>/*.png``; equal names are equal places, numbered from 0 in their order.

    Splits are ranges of frames, so that they share no place. Dark and repeated frames (tunnels, stops) are kept; they
    are flagged by :attr:`PlaceImages.flat <sextant.chapters.places.data.PlaceImages.flat>` and ``still``.

    Args:
        conditions: the seasons' folders; by convention the first is the map.
        frames: by split, the first frame and the one after the last (None: to the end).
        height: rows of the images.
        width: columns of the images.
        channels: 3 for colour, 1 for grey.
        folder: the folder that holds the seasons, absolute or below one of the ``roots``.
        skip_bad: leave out frames that cannot be decoded, and let a season lack frames; otherwise these are errors.
        roots: folders to search; decoded images are kept in the last.

    Raises:
        UserError: an argument is invalid.
    """

    name = "nordland"
    place_unit: Literal["m", "frames"] = "frames"

    def __init__(
        self,
        conditions: Sequence[str] = ("summer", "winter"),
        frames: Mapping[str, Sequence[int | None]] | None = None,
        height: int = 32,
        width: int = 64,
        channels: int = 3,
        folder: str = "nordland",
        skip_bad: bool = False,
        roots: Sequence[Path | str] = (),
    ):
        self.seasons = tuple(conditions)
        if not conditions or len(set(conditions)) < len(conditions):
            raise ArgumentError(
                f"conditions={list(conditions)} must name folders, each once",
                "conditions='[summer,winter]'",
            )
        default = {"train": (0, 1600), "val": (1600, 1650), "test": (1650, 2400)}
        self.ranges = FrameRanges.of(frames or default)
        self.size, self.skip_bad = ImageSize(height, width, channels), skip_bad
        self.looked = [Path(folder).expanduser().absolute(), *(Path(root) / folder for root in roots)]
        self.cache = Path(roots[-1]) if roots else None

    @cached_property
    def folder(self) -> Path:
        """The first of the searched paths that is a folder."""
        return first_folder(
            self.looked,
            f"dataset={self.name}",
            "Put the frames of each season into a folder there, such as nordland/summer and nordland/winter, with "
            "equal names for\nequal places, or set SEXTANT_DATA to the folder that holds nordland. "
            "Without any download: dataset=town_seasons",
        )

    @cached_property
    def rides(self) -> AlignedRides:
        """The files of all seasons by frame number.

        Raises:
            UserError: a season is missing, has no images, or lacks frames (the message names them).
        """
        traverses = {name: self.folder / name for name in self.seasons}
        there = sorted(path.name for path in self.folder.iterdir() if path.is_dir() and not is_hidden(path.name))
        absent = [name for name in self.seasons if name not in there]
        if absent:
            raise MissingDataError(
                f"conditions={list(self.seasons)}: {self.folder} has no folder {', '.join(absent)}; "
                f"it has {', '.join(there) or 'none'}",
                "Name folders that are there, or add the frames of that season.",
            )
        key = f"dataset={self.name}"
        return align_by_name(traverse_files(traverses, key), traverses, key, skip_missing=self.skip_bad)

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The seasons, the same for all splits."""
        return self.seasons

    def files(self, split: Split) -> list[Path]:
        """The frames of a split, season by season; nothing is decoded.

        Raises:
            UserError: the folder or frames of a season are missing, or the split's range goes beyond the last frame.
        """
        return [path for _, _, path in self._entries(split)]

    def _entries(self, split: Split) -> list[tuple[int, int, Path]]:
        """Traverse, frame and file of each image."""
        chosen = self.ranges.of_split(split, self.rides.count)
        return [
            (traverse, frame, self.rides.files[name][frame])
            for traverse, name in enumerate(self.seasons)
            for frame in chosen
            if frame in self.rides.files[name]
        ]

    def fingerprint(self) -> str:
        """Hash of the names and contents of all frames, of how they are split, and of their size."""
        entries = [
            [split, [[t, frame, path.name, file_sha256(path)] for t, frame, path in self._entries(split)]]
            for split in SPLITS
        ]
        size = [self.size.height, self.size.width, self.size.channels]
        return hashlib.sha256(json.dumps([entries, self.seasons, size]).encode()).hexdigest()

    def read(self, split: Split) -> PlaceImages:
        """The frames of a split, decoded the first time and memory-mapped from the cache afterwards.

        Raises:
            UserError: frames are missing or cannot be decoded; the message names them.
        """
        entries = self._entries(split)
        decoded = read_images(
            [path for _, _, path in entries],
            self.size,
            self.cache,
            what=f"{split} frames of dataset={self.name}",
            skip_bad=self.skip_bad,
            together=Together(
                f"dataset={self.name}", lambda: [path for ride in self.rides.files.values() for path in ride.values()]
            ),
        )
        kept = [entries[i] for i in decoded.kept]
        traverse, frame = np.array([(t, i) for t, i, _ in kept], np.int64).reshape(-1, 2).T
        for k, name in enumerate(self.seasons):
            if not np.any(traverse == k):
                raise ArgumentError(
                    f"dataset={self.name}: {name} has no {split} frame that can be read",
                    f"Add frames, or choose others: frames.{split}=[first,after]",
                )
        chosen = self.ranges.of_split(split, self.rides.count)
        lacking = tuple(f"{name} is missing" for frame, name in self.rides.missing if frame in chosen)
        return PlaceImages(
            decoded.images,
            np.ascontiguousarray(traverse),
            self.seasons,
            np.ascontiguousarray(frame),
            tuple(f"{self.seasons[t]}/{path.name}" for t, _, path in kept),
            skipped=decoded.bad + lacking,
        )
