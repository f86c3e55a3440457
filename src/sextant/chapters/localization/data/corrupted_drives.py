"""Copies of the test drives under image corruptions, at the images' own size; the dataset is otherwise unchanged."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Int64, UInt8
from numpy import ndarray

from sextant.chapters.localization.data.drive import Drive, LocalizationData
from sextant.chapters.localization.data.simulated import Split
from sextant.chapters.localization.data.source import LocalizationSource
from sextant.chapters.places.data import ImageRows
from sextant.corruptions import Condition, CorruptionSuite

#: number of corrupted images of a drive whose hash identifies the implementation of a corruption
PROBES = 4


class CorruptedRows(ImageRows):
    """Images that are corrupted whenever they are read, each by its own number.

    Args:
        images: the clean images.
        numbers: number of each among the test images, which seeds its corruption.
        suite: the corruptions.
        condition: one of its conditions.
        named: identifies the suite's settings.
    """

    def __init__(
        self,
        images: ImageRows,
        numbers: Int64[ndarray, "n"],
        suite: CorruptionSuite,
        condition: Condition,
        named: str,
    ):
        self.clean, self.numbers, self.suite, self.condition, self.named = images, numbers, suite, condition, named
        super().__init__(images.store, images.rows)

    @property
    def altered(self) -> str:
        """The condition, the suite's settings, and a hash of a few corrupted images."""
        shown = np.unique(np.linspace(0, len(self) - 1, min(PROBES, len(self))).astype(np.int64))
        probe = hashlib.sha256(np.ascontiguousarray(self[shown]).tobytes()).hexdigest()
        return f"{self.condition.key} {self.named} {probe}"

    def __getitem__(self, indices: int | slice | Sequence[int] | ndarray) -> UInt8[ndarray, "*k h w c"]:
        """Corrupted images by index."""
        found = self.clean[indices]
        batch = found.reshape(-1, *found.shape[-3:])
        return self.suite.corrupt_bytes(batch, np.atleast_1d(self.numbers[indices]), self.condition).reshape(
            found.shape
        )

    def select(self, indices: ndarray) -> "CorruptedRows":
        """Some of these images."""
        chosen = self.clean.select(indices), self.numbers[indices]
        return CorruptedRows(*chosen, self.suite, self.condition, self.named)


class CorruptedDrives:
    """A source whose test also has every drive under each corruption at each severity.

    The runs along them are those along the clean drives: the same frames, odometry and random numbers, so that they
    differ only in the images. Map and validation drives stay clean, so nothing is fitted to corrupted images.

    Args:
        source: of the clean drives.
        suite: the corruptions, the same for every run.
        named: identifies the suite's settings.
    """

    def __init__(self, source: LocalizationSource, suite: CorruptionSuite, named: str):
        self.source, self.suite, self.named, self.name = source, suite, named, source.name

    def conditions(self) -> tuple[str, ...]:
        """The conditions of the source."""
        return self.source.conditions()

    def files(self, split: Split) -> list[Path]:
        """The files of the source.

        Raises:
            UserError: whatever the source raises.
        """
        return self.source.files(split)

    def fingerprint(self) -> str:
        """The fingerprint of the source: the suite is part of the run's config."""
        return self.source.fingerprint()

    def read(self) -> LocalizationData:
        """All drives; corrupted images are made when they are read.

        Raises:
            UserError: whatever the source raises.
        """
        data, first, corrupted = self.source.read(), 0, list[Drive]()
        for drive in data.test:
            if drive.images is None:
                continue
            numbers = first + np.arange(len(drive))
            first += len(drive)
            corrupted += [self._under(drive, drive.images, numbers, each) for each in self.suite.conditions()[1:]]
        return replace(data, corrupted=tuple(corrupted))

    def _under(self, drive: Drive, images: ImageRows, numbers: Int64[ndarray, "n"], condition: Condition) -> Drive:
        rows = CorruptedRows(images, numbers, self.suite, condition, self.named)
        return replace(drive, name=f"{drive.name}, {condition.key}", images=rows, corruption=condition.key)
