"""The place recognition network: built from a config or a checkpoint, and as a describer of photos."""

from collections.abc import Callable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray
from torch import nn

from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.errors import UserError
from sextant.kit.trained import own_config, trained_network
from sextant.models import FeatureMap, PlaceNet
from sextant.models.onnx_place_net import OnnxPlaceNet
from sextant.models.published_place_net import PublishedPlaceNet
from sextant.runs.checkpoint import KEY


def place_network(
    raw: Mapping[str, Any], spec: Mapping[str, Any], build: Callable[..., Any]
) -> PlaceNet | PublishedPlaceNet | OnnxPlaceNet:
    """Build the network, with new weights.

    Args:
        raw: the config, as plain values.
        spec: ``channels``, ``height`` and ``width`` of its images; the ``mean`` and ``std`` by which they are
            standardised, by default 0.5 each, as in runs of earlier releases.
        build: builds the part for a group of the config, with further arguments.

    Raises:
        UserError: a part cannot be built, or the inhibition does not fit the backbone.
    """
    task, size = raw["task"], (spec["height"], spec["width"])
    backbone = build("backbone", in_channels=spec["channels"], image_size=size, num_classes=task["dimension"])
    if isinstance(backbone, PublishedPlaceNet | OnnxPlaceNet):  # it pools as its authors do
        return backbone
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
        mean=spec.get("mean"),
        std=spec.get("std"),
    )


def device_of(network: nn.Module) -> torch.device:
    """The device of a network's arrays, which may be buffers alone."""
    return next(chain(network.parameters(), network.buffers())).device


class TrainedPlaceNetwork:
    """A trained network as a describer of photos.

    Args:
        network: the network with its weights.
        size: of its images.
        model: identifies the network.
    """

    def __init__(self, network: nn.Module, size: ImageSize, model: str):
        self.network, self.size, self.model = network.eval(), size, model
        self.dimension = getattr(network, "dimension", None)

    @torch.no_grad()
    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """Descriptors of images of bytes, on the network's device."""
        device = device_of(self.network)
        images = np.require(images, requirements="W")  # torch warns of read-only arrays, as decoded files are
        batch = torch.from_numpy(images).permute(0, 3, 1, 2).to(device).float() / 255
        return np.ascontiguousarray(self.network(batch).float().cpu().numpy())


def trained_place_network(
    content: Mapping[str, Any], file: Path, model: str, *, trust: bool = False
) -> TrainedPlaceNetwork:
    """Load the network of a place-recognition run.

    Args:
        content: content of its checkpoint.
        file: the file that the weights come from, for error messages.
        model: identifies the network among others.
        trust: build user-defined parts that the config names.

    Raises:
        UserError: the run is of another task, its config is wrong or names user-defined code, or the weights do not
            fit or are not finite.
    """
    trained = content[KEY]
    if trained["task"] != "place_recognition":
        raise UserError(
            f"a network of task={trained['task']} has no place descriptor", "Name a run of task=place_recognition."
        )
    config, spec = own_config(trained, trust=trust), trained["spec"]
    size = ImageSize(spec["height"], spec["width"], spec["channels"])
    return TrainedPlaceNetwork(trained_network(config, content, file), size, model)
