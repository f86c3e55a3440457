"""Batches of panorama crops; an epoch's crops are a function of (seed, epoch), so a resumed run sees the same ones.

A crop is identified by its panorama and its draw number. Training draws are new in every epoch; validation and test
draws are the same for every run.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Int64
from numpy import ndarray
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from sextant.data.calibration.augmentation import augmented
from sextant.data.calibration.camera_distributions import CameraDistribution
from sextant.data.calibration.crop_batch import CropBatch
from sextant.data.calibration.crops import crop_batch
from sextant.data.calibration.detail import with_detail
from sextant.geometry import CameraParameters
from sextant.geometry.canvas import on_canvas

if TYPE_CHECKING:
    from sextant.data.calibration.panoramas import Panoramas


class Crops(Dataset[CropBatch]):
    """Crops of panoramas by number: ``crops[[3, 1, 4]]`` is one batch of three.

    Number ``i`` is draw ``i // n`` of panorama ``i % n``, with n panoramas.

    Args:
        panoramas: the panoramas to crop.
        distribution: of the cameras.
        width: of a crop in pixels.
        height: of a crop in pixels.
        seed: of the draws.
        antialias: average over the area of a pixel.
        augment: change the light and the sensor, and mirror; see :mod:`~sextant.data.calibration.augmentation`.
        keep: remember every batch, for crops that are requested repeatedly.
        canvas: crops are squares of ``width`` with the whole picture in the middle (:mod:`sextant.geometry.canvas`);
            otherwise pictures are squashed to the crop.
        detail: fewest and most lines of detail left in a training crop; see :mod:`sextant.data.calibration.detail`.
    """

    def __init__(
        self,
        panoramas: "Panoramas",
        distribution: CameraDistribution,
        width: int,
        height: int,
        seed: int,
        *,
        antialias: bool = True,
        augment: bool = False,
        keep: bool = False,
        canvas: bool = False,
        detail: tuple[float, float] | None = None,
    ):
        self.panoramas, self.distribution, self.seed, self.augment = panoramas, distribution, seed, augment
        self._kept: dict[bytes, CropBatch] | None = {} if keep else None
        self.width, self.height, self.antialias = width, height, antialias
        self.canvas, self.detail = canvas, detail

    def __getitem__(self, numbers: list[int] | Tensor) -> CropBatch:
        chosen = np.asarray(numbers, np.int64)
        if self._kept is None:
            return self._cut(chosen)
        if chosen.tobytes() not in self._kept:
            self._kept[chosen.tobytes()] = self._cut(chosen)
        return self._kept[chosen.tobytes()]

    def _cut(self, chosen: Int64[ndarray, "b"]) -> CropBatch:
        which, draws = chosen % len(self.panoramas), chosen // len(self.panoramas)
        draw = self.distribution.draw_for(which, draws, self.seed)
        shown = draw
        if self.canvas:
            shown = replace(draw, cameras=on_canvas(draw.cameras, draw.aspect), aspect=torch.ones_like(draw.aspect))
        images = crop_batch(
            self.panoramas, which, shown, self.width, self.height,
            k2_of_k1=self.distribution.k2_of_k1, antialias=self.antialias,
        )  # fmt: skip
        if self.detail is not None:
            images = with_detail(np.asarray(images), self.detail, chosen, self.seed)
        batch = CropBatch(
            torch.as_tensor(images),
            draw.cameras.to(dtype=torch.float32),
            draw.aspect.float(),
            torch.from_numpy(which),
            torch.from_numpy(chosen),
        )
        return augmented(batch, self.seed) if self.augment else batch

    def cameras(self, count: int) -> CameraParameters:
        """The first ``count`` cameras without their images, in float64."""
        numbers: Int64[ndarray, "n"] = np.arange(count)
        n = len(self.panoramas)
        return self.distribution.draw_for(numbers % n, numbers // n, self.seed).cameras


class CropSampler(Sampler[Tensor]):
    """Batches of crop numbers.

    Args:
        count: crops in an epoch.
        batch_size: crops in a batch; the last of an epoch may be smaller.
        seed: of the order; None keeps the order, and the same crops in every epoch.
    """

    def __init__(self, count: int, batch_size: int, seed: int | None = None):
        self.count, self.batch_size, self.seed = count, batch_size, seed
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch; the trainer calls this before each."""
        self.epoch = epoch

    def __len__(self) -> int:
        return math.ceil(self.count / self.batch_size)

    def __iter__(self) -> Iterator[Tensor]:
        numbers = torch.arange(self.count)
        if self.seed is not None:
            generator = torch.Generator().manual_seed(self.seed * 1_000_003 + self.epoch)
            numbers = self.epoch * self.count + torch.randperm(self.count, generator=generator)
        return iter(numbers.split(self.batch_size))
