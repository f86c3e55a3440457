"""AugMix: several chains of simple operations, mixed with the image.

Source: D. Hendrycks et al., "AugMix: a simple data processing method to improve robustness and uncertainty", ICLR 2020;
the implementation is torchvision's. The paper's consistency loss between several versions of an image is not included.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Int64, UInt8
from torch import Tensor

from sextant.data.augmentation.pad_crop_flip import PadCropFlip
from sextant.data.counters import uniforms

if TYPE_CHECKING:
    from torchvision.transforms.v2 import AugMix as TorchvisionAugMix


@dataclass(frozen=True)
class AugMix:
    """Shifts and mirrors an image, then mixes it with chains of operations.

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
