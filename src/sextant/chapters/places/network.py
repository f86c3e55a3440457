"""The place recognition network: built from a config, and as a describer of photos."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray
from torch import nn

from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.errors import UserError
from sextant.models import FeatureMap, PlaceNet


def place_network(raw: Mapping[str, Any], spec: Mapping[str, Any], build: Callable[..., Any]) -> PlaceNet:
    """Build the network, with new weights.

    Args:
        raw: the config, as plain values.
        spec: ``channels``, ``height`` and ``width`` of its images.
        build: builds the part for a group of the config, with further arguments.

    Raises:
        UserError: a part cannot be built, or the inhibition does not fit the backbone.
    """
    task, size = raw["task"], (spec["height"], spec["width"])
    backbone = build("backbone", in_channels=spec["channels"], image_size=size, num_classes=task["dimension"])
    try:
        features = FeatureMap(backbone, spec["channels"], size, layer=task["layer"])
        features = build("inhibition")(features)
    except ValueError as error:
        raise UserError(f"inhibition: {error}", "Choose another backbone, or inhibition=none") from None
    return PlaceNet(
        features,
        build("pooling", channels=features.channels, size=features.size),
        task["dimension"],
        normalise=task["normalise"],
        in_channels=spec["channels"],
    )


class TrainedPlaceNetwork:
    """A trained network as a describer of photos.

    Args:
        network: the network with its weights.
        size: of its images.
        model: identifies the network.
    """

    def __init__(self, network: nn.Module, size: ImageSize, model: str):
        self.network, self.size, self.model = network.eval(), size, model

    @torch.no_grad()
    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """Descriptors of images of bytes, on the network's device."""
        device = next(self.network.parameters()).device
        images = np.require(images, requirements="W")  # torch warns of read-only arrays, as decoded files are
        batch = torch.from_numpy(images).permute(0, 3, 1, 2).to(device).float() / 255
        return np.ascontiguousarray(self.network(batch).float().cpu().numpy())
