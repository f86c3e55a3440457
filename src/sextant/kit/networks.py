"""Networks built from the config and spec of a checkpoint, using only what is registered in them."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from torch import nn

from sextant.chapters.places.network import place_network
from sextant.config import Config
from sextant.config.building import build
from sextant.config.trained import without_weights
from sextant.errors import UserError
from sextant.kit.content import load_weights
from sextant.kit.image_spec import image_spec
from sextant.runs.checkpoint import KEY

#: tasks whose networks are built here
TASKS = ("classification", "place_recognition")


def classifier(config: Config, spec: Mapping[str, Any]) -> nn.Module:
    """The classification network with new weights and its inhibition; it maps images in [0, 1] to logits.

    Raises:
        UserError: a part cannot be built, or the inhibition does not fit the backbone.
    """
    images = image_spec(spec)
    network = build(
        config.plain,
        "backbone",
        in_channels=images.channels,
        image_size=(images.height, images.width),
        num_classes=len(images.classes),
    )
    try:
        return build(config.plain, "inhibition")(network)  # type: ignore[no-any-return]
    except ValueError as error:
        raise UserError(f"inhibition: {error}", "Choose another backbone, or inhibition=none") from None


def new_network(config: Config, spec: Mapping[str, Any]) -> nn.Module:
    """Build the network of one of :data:`TASKS` with new weights.

    Raises:
        UserError: a part cannot be built.
    """
    config = without_weights(config)
    if config.task.name == "classification":
        return classifier(config, spec)
    return place_network(config.plain, spec, partial(build, config.plain))


def trained_network(config: Config, content: Mapping[str, Any], checkpoint: Path) -> Any:
    """Build the network of a checkpoint of one of :data:`TASKS`, with its weights, in evaluation mode.

    Args:
        config: the checkpoint's own config, from :func:`~sextant.kit.content.own_config`.
        content: content of the checkpoint, from :func:`~sextant.kit.content.read_trained`.
        checkpoint: the checkpoint's file, for error messages.

    Raises:
        UserError: a part cannot be built, or the weights do not fit or are not finite.
    """
    trained = content[KEY]
    whole = nn.ModuleDict({"network": new_network(config, trained["spec"])})
    # leave out what belongs to training alone, such as the state of a loss
    own = {name: value for name, value in content["state_dict"].items() if name.startswith("network.")}
    load_weights(whole, {"state_dict": own}, checkpoint)
    return whole["network"].eval()
