"""A batch of crops with their cameras."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64, UInt8
from torch import Tensor

from sextant.geometry import CameraParameters


@dataclass(frozen=True)
class CropBatch:
    """Crops with the cameras that they were taken with.

    Attributes:
        images: bytes, ``(b, 3, h, w)``.
        cameras: tilt, roll, focal and k1 of each, float32.
        aspect: width over height of each image before it was squashed to the crop's size.
        panoramas: index of the panorama of each.
        indices: numbers of the crops in the split, which seed corruptions.
        weight: of the mean over these crops when several processes share a batch.
    """

    images: UInt8[Tensor, "b 3 h w"]
    cameras: CameraParameters
    aspect: Float[Tensor, "b"]
    panoramas: Int64[Tensor, "b"]
    indices: Int64[Tensor, "b"]
    weight: float = 1.0

    def to(self, device: torch.device, non_blocking: bool = False) -> "CropBatch":
        """The batch on another device."""

        def moved(tensor: Tensor) -> Tensor:
            return tensor.to(device, non_blocking=non_blocking)

        return CropBatch(
            moved(self.images),
            CameraParameters(*map(moved, self.cameras)),
            moved(self.aspect),
            moved(self.panoramas),
            moved(self.indices),
            self.weight,
        )

    def images_in_unit_range(self) -> Tensor:
        """Images as float32 in [0, 1]."""
        return self.images.float() / 255
