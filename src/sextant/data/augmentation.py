"""Class-preserving augmentation of training images; the change of an image is a function of (seed, epoch, index)."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Int64, UInt8
from torch import Tensor
from torch.utils.data import Dataset

from sextant.data.batches import Batch, ImageBatches
from sextant.data.counters import uniforms
from sextant.errors import UserError

if TYPE_CHECKING:
    from torchvision.transforms.v2 import AugMix as TorchvisionAugMix

__all__ = ["AugMix", "Augmentation", "AugmentedBatches", "NoAugmentation", "PadCropFlip"]


class Augmentation(Protocol):
    """Changes a batch of training images."""

    def __call__(
        self, images: UInt8[Tensor, "b c h w"], indices: Int64[Tensor, "b"], epoch: int, seed: int
    ) -> UInt8[Tensor, "b c h w"]:
        """The images at positions ``indices`` of the training split as shown in ``epoch``.

        Each image depends only on its own index, the epoch and the seed, not on the batch it comes in.
        """


class NoAugmentation:
    """Unchanged training images."""

    def __call__(
        self, images: UInt8[Tensor, "b c h w"], indices: Int64[Tensor, "b"], epoch: int, seed: int
    ) -> UInt8[Tensor, "b c h w"]:
        """``images``."""
        return images


class AugmentedBatches(Dataset[Batch]):
    """Augmented images by number: ``i + epoch * n`` is image i of n as shown in that epoch.

    Args:
        images: the training split.
        augmentation: the change applied to them.
        seed: of the augmentation.
    """

    def __init__(self, images: ImageBatches, augmentation: Augmentation, seed: int):
        self.images, self.augmentation, self.seed = images, augmentation, seed

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, numbers: list[int] | Tensor) -> Batch:
        """A batch of one epoch."""
        chosen = torch.as_tensor(numbers)
        epoch = int(chosen[0]) // len(self)
        batch = self.images[chosen % len(self)]
        images = self.augmentation(batch.images, batch.indices, epoch, self.seed)
        return Batch(images, batch.labels, batch.indices)


@dataclass(frozen=True)
class AugMix:
    """Shifts and mirrors an image, then mixes it with chains of operations.

    Source: D. Hendrycks et al., "AugMix: a simple data processing method to improve robustness and uncertainty", ICLR
    2020; the implementation is torchvision's. The paper's consistency loss between several versions of an image is not
    included.

    None of its operations is one of the corruptions of CIFAR-10-C (``all_ops=False``, as in the paper).

    Args:
        severity: 1 to 10.
        width: number of chains.
        depth: operations per chain; -1 draws 1 to 3.
        alpha: parameter of the Dirichlet and Beta distributions of the weights.
        pad: pixels of padding for the shift before mixing; see :class:`PadCropFlip`.
        flip: mirror images at random before mixing.
    """

    severity: int = 3
    width: int = 3
    depth: int = -1
    alpha: float = 1.0
    pad: int = 4
    flip: bool = True

    def __call__(
        self, images: UInt8[Tensor, "b c h w"], indices: Int64[Tensor, "b"], epoch: int, seed: int
    ) -> UInt8[Tensor, "b c h w"]:
        """Mix images one by one: torchvision draws from torch's global random state, which is restored afterwards."""
        shifted = PadCropFlip(self.pad, "reflect", self.flip)(images, indices, epoch, seed)
        numbers = indices.numpy()
        (u,) = uniforms(numbers, np.full_like(numbers, epoch), 1, seed, 1)
        with torch.random.fork_rng(devices=[]):
            mixed = []
            for image, number in zip(shifted, u.tolist(), strict=True):
                torch.manual_seed(int(number * 2**32))
                mixed.append(self._mix(image))
        return torch.stack(mixed)

    @cached_property
    def _mix(self) -> "TorchvisionAugMix":
        from torchvision.transforms.v2 import AugMix as TorchvisionAugMix

        return TorchvisionAugMix(self.severity, self.width, self.depth, self.alpha, all_ops=False)


@dataclass(frozen=True)
class PadCropFlip:
    """Pads an image, crops it back to its size at a random place, and mirrors it with probability 1/2.

    Source: K. He et al., "Deep residual learning for image recognition", CVPR 2016, section 4.2; with reflected borders
    as in Strisciuglio et al. 2020.

    Args:
        pad: pixels on each side.
        mode: how the border is filled; ``reflect`` needs images larger than ``pad``.
        flip: mirror images; leave it off for digits and letters.
    """

    pad: int = 4
    mode: Literal["reflect", "replicate", "constant"] = "reflect"
    flip: bool = True

    def __call__(
        self, images: UInt8[Tensor, "b c h w"], indices: Int64[Tensor, "b"], epoch: int, seed: int
    ) -> UInt8[Tensor, "b c h w"]:
        """Shifted and mirrored images.

        Raises:
            UserError: the images are too small to be reflected that far.
        """
        height, width = images.shape[-2:]
        if self.mode == "reflect" and self.pad >= min(height, width):
            raise UserError(
                f"augmentation.pad={self.pad}: images of {height}x{width} cannot be reflected that far",
                f"augmentation.pad must be below {min(height, width)}, or augmentation.mode=replicate",
            )
        numbers = indices.numpy()
        u = uniforms(numbers, np.full_like(numbers, epoch), 0, seed, 3)
        top, left = (torch.from_numpy((u[i] * (2 * self.pad + 1)).astype(np.int64)) for i in (0, 1))
        count, channels = images.shape[:2]
        sides = (self.pad, self.pad, self.pad, self.pad)
        padded = F.pad(images.float(), sides, mode=self.mode).to(torch.uint8)  # reflection is not implemented for bytes
        columns = torch.arange(width).expand(count, width)
        if self.flip:
            mirrored = torch.from_numpy(u[2] < 0.5)[:, None]
            columns = torch.where(mirrored, columns.flip(1), columns)
        columns = (columns + left[:, None])[:, None, None, :]
        rows = (torch.arange(height) + top[:, None])[:, None, :, None]
        which = torch.arange(count)[:, None, None, None]
        return padded[which, torch.arange(channels)[None, :, None, None], rows, columns]
