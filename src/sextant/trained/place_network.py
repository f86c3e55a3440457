"""The network of a run of place recognition, as what describes photos."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.data.places.decoded_images import ImageSize
from sextant.errors import UserError
from sextant.runs.checkpoint import KEY
from sextant.tasks.places.network import TrainedPlaceNetwork
from sextant.trained.content import own_config
from sextant.trained.networks import trained_network


def trained_place_network(
    content: Mapping[str, Any], file: Path, model: str, *, trust: bool = False
) -> TrainedPlaceNetwork:
    """The network of a run of place recognition.

    Args:
        content: of its checkpoint.
        file: that the weights come from, for messages.
        model: what distinguishes it from other networks.
        trust: build parts of the user's own that the config names.

    Raises:
        UserError: of another task, with a wrong config or code of the user's own in it, or weights that do not fit
            or are not finite.
    """
    trained = content[KEY]
    if trained["task"] != "place_recognition":
        raise UserError(
            f"a network of task={trained['task']} gives no place descriptor", "Name a run of task=place_recognition."
        )
    config, spec = own_config(trained, trust=trust), trained["spec"]
    size = ImageSize(spec["height"], spec["width"], spec["channels"])
    return TrainedPlaceNetwork(trained_network(config, content, file), size, model)
