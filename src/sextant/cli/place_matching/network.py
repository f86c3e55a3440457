"""A trained module as what describes photos."""

from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.data.places.decoded_images import ImageSize

if TYPE_CHECKING:
    from sextant.tasks.place_recognition import PlaceRecognition


class TrainedNetwork:
    """A module of place recognition as a :class:`~sextant.cli.place_matching.describing.PlaceDescriber`."""

    def __init__(self, module: "PlaceRecognition", model: str):
        self.module, self.model = module.eval(), model
        self.size = ImageSize(module.spec.height, module.spec.width, module.spec.channels)

    @torch.no_grad()
    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """Descriptors of images of bytes, on the module's device."""
        batch = torch.from_numpy(images).permute(0, 3, 1, 2).to(self.module.device).float() / 255
        return np.ascontiguousarray(self.module.predict_step(batch).float().cpu().numpy())
