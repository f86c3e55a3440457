"""The augmentation protocol, and the augmentation that changes nothing."""

from typing import Protocol

from jaxtyping import Int64, UInt8
from torch import Tensor


class Augmentation(Protocol):
    """Changes a batch of training images."""

    def __call__(
        self, images: UInt8[Tensor, "b c h w"], indices: Int64[Tensor, "b"], epoch: int, seed: int
    ) -> UInt8[Tensor, "b c h w"]:
        """The images at positions ``indices`` of the training split as shown in ``epoch``.

        Each image depends only on its own index, the epoch and the seed, not on the batch it comes in.
        """


class NoAugmentation:
    """Training images as they are."""

    def __call__(
        self, images: UInt8[Tensor, "b c h w"], indices: Int64[Tensor, "b"], epoch: int, seed: int
    ) -> UInt8[Tensor, "b c h w"]:
        """``images``."""
        return images
