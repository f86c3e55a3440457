"""Whole batches by index; an epoch's order is a function of (seed, epoch), so a resumed run sees the same images."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Int64, UInt8
from torch import Tensor
from torch.utils.data import Dataset, Sampler


@dataclass(frozen=True)
class Batch:
    """A batch of images as they lie in memory.

    Attributes:
        images: bytes, ``(b, c, h, w)``.
        labels: class indices.
        indices: positions in the split, which seed the corruptions.
    """

    images: UInt8[Tensor, "b c h w"]
    labels: Int64[Tensor, "b"]
    indices: Int64[Tensor, "b"]

    def to(self, device: torch.device, non_blocking: bool = False) -> "Batch":
        """The batch on another device."""
        tensors = (self.images, self.labels, self.indices)
        return Batch(*(tensor.to(device, non_blocking=non_blocking) for tensor in tensors))

    def images_in_unit_range(self) -> Tensor:
        """Images as float32 in [0, 1]."""
        return self.images.float() / 255


class ImageBatches(Dataset[Batch]):
    """Images in memory, read a whole batch at a time: ``dataset[[3, 1, 4]]`` is one batch of three."""

    def __init__(self, images: UInt8[Tensor, "n c h w"], labels: Int64[Tensor, "n"]):
        self.images, self.labels = images, labels

    def __len__(self) -> int:
        return len(self.labels)

    def none(self) -> "ImageBatches":
        """No image of the same shape."""
        return ImageBatches(self.images[:0], self.labels[:0])

    def __getitem__(self, indices: list[int] | Tensor) -> Batch:
        chosen = torch.as_tensor(indices)
        return Batch(self.images[chosen], self.labels[chosen], chosen)


class EpochBatches(Sampler[Tensor]):
    """Index batches of one epoch, shuffled by a generator seeded with (seed, epoch), or in order.

    Args:
        count: number of images.
        batch_size: images in a batch; the last one of an epoch may be smaller.
        seed: of the shuffling; None keeps the order.
        rank, ranks: this process among those that share the epoch; each takes every ``ranks``-th batch, and the last
            batches that would not go round are left out.
        every: take every k-th image.
        numbered: give ``index + epoch * count`` instead of the index, for images that differ from epoch to epoch.
    """

    def __init__(
        self,
        count: int,
        batch_size: int,
        seed: int | None = None,
        rank: int = 0,
        ranks: int = 1,
        *,
        every: int = 1,
        numbered: bool = False,
    ):
        self.count, self.batch_size, self.seed, self.every = count, batch_size, seed, every
        self.rank, self.ranks, self.numbered = rank, ranks, numbered
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch; the trainer calls this before each."""
        self.epoch = epoch

    def __len__(self) -> int:
        batches = len(range(0, self.count, self.every * self.batch_size))
        return batches // self.ranks if self.ranks > 1 else batches

    def __iter__(self) -> Iterator[Tensor]:
        order = torch.arange(0, self.count, self.every)
        if self.seed is not None:
            generator = torch.Generator().manual_seed(self.seed * 1_000_003 + self.epoch)
            order = order[torch.randperm(len(order), generator=generator)]
        if self.numbered:
            order = order + self.epoch * self.count
        batches = order.split(self.batch_size)
        return iter(batches[self.rank :: self.ranks][: len(self)])
