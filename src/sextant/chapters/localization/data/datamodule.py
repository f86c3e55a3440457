"""The drives of a dataset with their descriptors, on which a localizer is fitted and tested."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Float32, Int64
from numpy import ndarray
from torch import Tensor
from torch.utils.data import DataLoader

from sextant.chapters.localization.data.described import DescribedDrives, Showing, silent
from sextant.chapters.localization.data.drive import Drive, LocalizationData
from sextant.chapters.localization.data.source import LocalizationSource
from sextant.chapters.places.descriptors import Describer


class Vectors(Protocol):
    """Descriptors of drives that were computed elsewhere."""

    def of(self, drive: str, count: int) -> Float32[ndarray, "n d"]:
        """The vectors of a drive, by its name, of ``count`` images."""


class LocalizationDataModule(pl.LightningDataModule):
    """Reads drives once, describes their images once, and serves rows of the map for training the kernel.

    Args:
        source: of the drives.
        describer: of images, or vectors by drive.
        cache: folder that descriptors are kept in.
        images: number of map images in one training step; all of them if there are fewer.
        fixed: use the same images in every step, so that one likelihood is maximized; otherwise different ones in each.
        steps: training steps in an epoch.
        seed: of the choice of images.
        merge_duplicates: merge map images at the same pose into one.
        show: makes the progress display of one drive.
    """

    def __init__(
        self,
        source: LocalizationSource,
        describer: Describer | Vectors,
        cache: Path,
        *,
        images: int,
        fixed: bool = True,
        steps: int = 10,
        seed: int = 0,
        merge_duplicates: bool = False,
        show: Showing = silent,
    ):
        super().__init__()
        self.source, self.describer, self.cache = source, describer, cache
        self.images, self.fixed, self.steps, self.seed, self.show = images, fixed, steps, seed, show
        self.merge_duplicates = merge_duplicates
        self._data: LocalizationData | None = None
        self._described: DescribedDrives | None = None

    @property
    def drives(self) -> LocalizationData:
        """All drives, read on first use."""
        if self._data is None:
            self._data = self.source.read()
        return self._data

    def descriptors(self, drive: Drive) -> Float32[ndarray, "n d"]:
        """Descriptors of the images of a drive, or of some of its frames, memory-mapped from the cache."""
        if not isinstance(self.describer, Describer):
            return self.describer.of(drive.name, len(drive))
        if self._described is None:
            self._described = DescribedDrives(self.describer, self.source.fingerprint(), self.cache, self.show)
            self._described.fit(self.drives.fitted)
        return self._described.of(drive)

    @property
    def dimension(self) -> int:
        """Length of a descriptor."""
        return int(self.descriptors(self.drives.map).shape[1])

    def train_dataloader(self) -> DataLoader[Tensor]:
        """Rows of the map for every step of an epoch, a function of (seed, epoch)."""
        epoch = 0 if self.trainer is None else self.trainer.current_epoch
        return DataLoader(_Rows(self.choices(epoch)), batch_size=None)

    def choices(self, epoch: int) -> list[Int64[ndarray, "k"]]:
        """Rows of the map that is fitted to, for every step of an epoch: evenly spaced if fixed, at random if not."""
        count = len(self.drives.fitted)
        if self.fixed:
            rows = np.unique(np.linspace(0, count - 1, min(self.images, count)).astype(np.int64))
            return [rows] * self.steps
        rng = np.random.default_rng([self.seed, 81, epoch])
        return [np.sort(rng.choice(count, min(self.images, count), replace=False)) for _ in range(self.steps)]

    def val_dataloader(self) -> DataLoader[Tensor] | list[Tensor]:
        """One batch for the whole validation; none during training, where it is not used for selection."""
        state = None if self.trainer is None else self.trainer.state.fn
        return [] if state == "fit" else DataLoader(_Rows([np.zeros(1, np.int64)]), batch_size=None)

    def test_dataloader(self) -> DataLoader[Tensor]:
        """One batch for the whole test."""
        return DataLoader(_Rows([np.zeros(1, np.int64)]), batch_size=None)


class _Rows(torch.utils.data.Dataset[Tensor]):
    """Rows of the map by step."""

    def __init__(self, choices: Sequence[Int64[ndarray, "k"]]):
        self._choices = choices

    def __len__(self) -> int:
        return len(self._choices)

    def __getitem__(self, step: int) -> Tensor:
        return torch.from_numpy(self._choices[step])
