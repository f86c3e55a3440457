"""Corrupted queries: copies of the test drives with image corruptions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Int64, UInt8
from numpy import ndarray

from sextant.chapters.places.data.image_rows import ImageRows
from sextant.chapters.places.data.images import PlaceImages, Split
from sextant.chapters.places.data.source import PlaceSource
from sextant.corruptions import CorruptionSuite
from sextant.errors import UserError


def corrupted_name(condition: str) -> str:
    """The name of the corrupted copy of a condition."""
    return f"{condition}_corrupted"


class CorruptedQueries:
    """A source whose test split has each drive except the map twice: clean, and corrupted as ``<condition>_corrupted``.

    Image k of a corrupted drive, in frame order, gets condition k modulo n of the suite's n conditions (a corruption at
    a severity). If the drive is much longer than n, its recall estimates the mean over the suite at the cost of one
    more drive. Which queries are flat or still is taken from the clean drive. Training, validation and the map stay
    clean.

    The images of the test split are held in memory and corrupted once.

    Args:
        source: of the clean images.
        suite: the corruptions, the same for every run.
    """

    def __init__(self, source: PlaceSource, suite: CorruptionSuite):
        self.source, self.suite = source, suite
        self._test: PlaceImages | None = None
        self.name, self.place_unit = source.name, source.place_unit

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The conditions of the source, and in the test the corrupted ones.

        Raises:
            UserError: whatever the source raises.
        """
        clean = self.source.conditions(split)
        if split != "test":
            return clean
        copies = tuple(corrupted_name(name) for name in clean[1:])
        if taken := set(copies) & set(clean):
            raise UserError(f"corruption: the dataset has a condition {min(taken)} of its own", "corruption=none")
        return (*clean, *copies)

    def files(self, split: Split) -> list[Path]:
        """The files of the source.

        Raises:
            UserError: whatever the source raises.
        """
        return self.source.files(split)

    def fingerprint(self) -> str:
        """The fingerprint of the source: the suite is part of the run's config."""
        return self.source.fingerprint()

    def read(self, split: Split) -> PlaceImages:
        """The images of a split; in the test, corrupted images follow the clean ones.

        Raises:
            UserError: whatever the source raises.
        """
        if split != "test":
            return self.source.read(split)
        if self._test is None:
            self._test = self._with_copies(self.conditions("test"), self.source.read("test"))
        return self._test

    def _with_copies(self, conditions: tuple[str, ...], clean: PlaceImages) -> PlaceImages:
        drives = [clean.rows_of(name) for name in clean.conditions[1:]]
        rows = np.concatenate([np.arange(len(clean)), *drives])
        both = clean.select(rows)
        images, under, traverse = both.images[:], self.suite.conditions()[1:], both.traverse.copy()
        start = len(clean)
        for number, drive in enumerate(drives, start=len(clean.conditions)):
            mine = slice(start, start + len(drive))
            traverse[mine] = number
            images[mine] = self._corrupted(images[mine], drive)
            start = mine.stop
        keys = [under[k % len(under)].key for drive in drives for k in range(len(drive))]
        names = (*clean.names, *(f"{name} {key}" for name, key in zip(both.names[len(clean) :], keys, strict=True)))
        return replace(
            both, images=ImageRows(images), traverse=traverse, conditions=conditions, names=names,
            copies=conditions[len(clean.conditions) :], content=(clean.flat[rows], clean.still[rows]),
        )  # fmt: skip

    def _corrupted(self, images: UInt8[ndarray, "n h w c"], numbers: Int64[ndarray, "n"]) -> UInt8[ndarray, "n h w c"]:
        """A drive with each image under the next condition; ``numbers``, of its images in the split, are the seeds."""
        found, under = images.copy(), self.suite.conditions()[1:]
        for first, condition in enumerate(under):
            mine = np.arange(first, len(images), len(under))
            found[mine] = self.suite.corrupt_bytes(images[mine], numbers[mine], condition)
        return found
