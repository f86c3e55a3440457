"""Whole batches by index; an epoch's order is a function of (seed, epoch), so a resumed run gets the same images."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import torch
from jaxtyping import Int64, UInt8
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

Kind = TypeVar("Kind")


class StoredImages:
    """A batch of images as stored in memory: a dataclass of tensors, named tuples of tensors and plain values."""

    images: UInt8[Tensor, "b c h w"]

    def to(self, device: torch.device, non_blocking: bool = False) -> Self:
        """The batch on another device."""

        def moved(value: Any) -> Any:
            if isinstance(value, tuple):
                return type(value)(*map(moved, value))
            return value.to(device, non_blocking=non_blocking) if isinstance(value, Tensor) else value

        return replace(self, **{name: moved(value) for name, value in vars(self).items()})  # type: ignore[type-var]

    def images_in_unit_range(self) -> Tensor:
        """Images as float32 in [0, 1]."""
        return self.images.float() / 255


@dataclass(frozen=True)
class Batch(StoredImages):
    """A batch of labelled images.

    Attributes:
        images: bytes, ``(b, c, h, w)``.
        labels: class indices.
        indices: positions in the split, which seed the corruptions.
        weight: of the mean over these images when several processes share a batch.
    """

    images: UInt8[Tensor, "b c h w"]
    labels: Int64[Tensor, "b"]
    indices: Int64[Tensor, "b"]
    weight: float = 1.0


class ImageBatches(Dataset[Batch]):
    """Images in memory, read a whole batch at a time: ``dataset[[3, 1, 4]]`` is one batch of three."""

    def __init__(self, images: UInt8[Tensor, "n c h w"], labels: Int64[Tensor, "n"]):
        self.images, self.labels = images, labels

    def __len__(self) -> int:
        return len(self.labels)

    def none(self) -> "ImageBatches":
        """An empty set of images of the same shape."""
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
        every: take every k-th image.
        numbered: yield ``index + epoch * count`` instead of the index, for images that differ from epoch to epoch.
    """

    def __init__(
        self,
        count: int,
        batch_size: int,
        seed: int | None = None,
        *,
        every: int = 1,
        numbered: bool = False,
    ):
        self.count, self.batch_size, self.seed, self.every = count, batch_size, seed, every
        self.numbered = numbered
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch; the trainer calls this before each."""
        self.epoch = epoch

    def __len__(self) -> int:
        return len(range(0, self.count, self.every * self.batch_size))

    def __iter__(self) -> Iterator[Tensor]:
        order = torch.arange(0, self.count, self.every)
        if self.seed is not None:
            generator = torch.Generator().manual_seed(self.seed * 1_000_003 + self.epoch)
            order = order[torch.randperm(len(order), generator=generator)]
        if self.numbered:
            order = order + self.epoch * self.count
        return iter(order.split(self.batch_size))


def epoch_of(trainer: Any) -> int:
    """The epoch that a Lightning trainer has reached; 0 without a trainer.

    On resuming, Lightning takes the first iterator before it sets the sampler's epoch.
    """
    return 0 if trainer is None else int(trainer.fit_loop.epoch_progress.current.processed)


def loader(images: Dataset[Kind], batches: Sampler[Tensor], workers: int = 0) -> DataLoader[Kind]:
    """Whole batches by index, fetched by as many processes as there are workers; by none, in this one."""
    return DataLoader(images, sampler=batches, batch_size=None, num_workers=workers, persistent_workers=workers > 0)
