r"""Augmentation of training images by brightness, contrast and small shifts, none of which changes the place.

An image with values x in [0, 1] and the mean μ becomes

.. math:: c\,(x(u + s) - \mu) + b\,\mu ,

with a shift s of whole pixels, uniform in the disc of radius ``shift`` times the image's height (the border is
repeated), and with log contrast :math:`\log c` and log brightness :math:`\log b` uniform in :math:`\pm` ``contrast``
and :math:`\pm` ``brightness``. A mirrored street is another place: ``mirror`` mirrors all places in every other epoch,
which doubles their number. ``augmix`` then mixes the image with chains of simple operations, none of which is a
corruption that models are tested under; see :class:`.AugMix`.

The augmentation of an image is a function of (seed, number of the image) alone, not of its batch.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64, Int64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.data.augmentation import AugMix
from sextant.data.counters import uniforms


@dataclass(frozen=True)
class PlaceAugmentation:
    """How much training images are changed; zeros leave them as they are.

    Attributes:
        brightness: largest logarithm of the factor on the mean.
        contrast: largest logarithm of the factor on differences from the mean.
        shift: largest shift as a share of the height.
        mirror: mirror every image of epochs 1, 3, 5, ...; done where the epoch is known, by ``PlaceBatchImages``.
        augmix: severity of AugMix, 1 to 10; None for no AugMix.
    """

    brightness: float = 0.3
    contrast: float = 0.3
    shift: float = 0.05
    mirror: bool = False
    augmix: int | None = None

    def __post_init__(self) -> None:
        if min(self.brightness, self.contrast, self.shift) < 0 or self.shift >= 0.5:
            raise ValueError(f"strengths must be at least 0, and shift below 0.5, got {self}")

    def __call__(
        self, images: UInt8[Tensor, "b c h w"], numbers: Int64[ndarray, "b"], seed: int
    ) -> UInt8[Tensor, "b c h w"]:
        """Augment images as the module describes.

        Args:
            images: bytes.
            numbers: of the images, 0 or more.
            seed: of the run.
        """
        u = uniforms(numbers % 2**32, numbers // 2**32, 0, seed ^ 0xA11CE, 4)
        reach, angle = self.shift * images.shape[-2] * np.sqrt(u[2]), 2 * np.pi * u[3]
        down, right = np.rint(reach * np.sin(angle)), np.rint(reach * np.cos(angle))
        x = shifted(images, torch.from_numpy(down).long(), torch.from_numpy(right).long()).float()
        contrast = _factors(self.contrast * (2 * u[0] - 1))
        brightness = _factors(self.brightness * (2 * u[1] - 1))
        mean = x.mean((1, 2, 3), keepdim=True)
        changed = x.mul_(contrast).add_((brightness - contrast) * mean).round_().clamp_(0, 255).to(torch.uint8)
        if self.augmix is None:
            return changed
        mixed = AugMix(self.augmix, pad=0, flip=False)
        return mixed(changed, torch.from_numpy(numbers % 2**32), int(numbers[0] // 2**32), seed)


def shifted(
    images: UInt8[Tensor, "b c h w"], down: Int64[Tensor, "b"], right: Int64[Tensor, "b"]
) -> UInt8[Tensor, "b c h w"]:
    """Shift each image by whole pixels down and to the right, repeating its border."""
    height, width = images.shape[-2:]
    rows = (torch.arange(height) - down[:, None]).clamp(0, height - 1)
    columns = (torch.arange(width) - right[:, None]).clamp(0, width - 1)
    first = torch.arange(len(images))[:, None, None] * height
    pixels = ((first + rows[:, :, None]) * width + columns[:, None, :]).flatten()
    last = images.permute(0, 2, 3, 1)
    return last.reshape(-1, images.shape[1])[pixels].reshape(last.shape).permute(0, 3, 1, 2)


def _factors(logarithms: Float64[ndarray, "b"]) -> Tensor:
    return torch.from_numpy(np.exp(logarithms)).float()[:, None, None, None]
