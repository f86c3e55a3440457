"""Small random shifts and mirroring, the usual augmentation for CIFAR networks.

Source: K. He et al., "Deep residual learning for image recognition", CVPR 2016, section 4.2; with reflected borders as
in Strisciuglio et al. 2020.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Int64, UInt8
from torch import Tensor

from sextant.data.counters import uniforms
from sextant.errors import UserError


@dataclass(frozen=True)
class PadCropFlip:
    """Pads an image, crops it back to its size at a random place, and mirrors it with probability 1/2.

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
