"""The network of a place-recognition run, as a descriptor of photos."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.chapters.places.network import TrainedPlaceNetwork
from sextant.errors import UserError
from sextant.kit.content import own_config
from sextant.kit.networks import trained_network
from sextant.runs.checkpoint import KEY


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
            f"a network of task={trained['task']} gives no place descriptor", "Name a run of task=place_recognition."
        )
    config, spec = own_config(trained, trust=trust), trained["spec"]
    size = ImageSize(spec["height"], spec["width"], spec["channels"])
    return TrainedPlaceNetwork(trained_network(config, content, file), size, model)
