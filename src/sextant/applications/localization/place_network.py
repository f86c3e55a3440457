"""The network that a map was described with, from what the map keeps of it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

from sextant.config.build_part import build_part
from sextant.config.trained import trained_config
from sextant.data.places.decoded_images import ImageSize
from sextant.errors import UserError
from sextant.tasks.places.network import TrainedPlaceNetwork, place_network
from sextant.torch_file import require_finite

#: the network's part of the weights of a module of place recognition
PREFIX = "network."
#: what belongs to a run, not to the network that it trained
_OF_THE_RUN = {"reuse": "exact", "init_from": None, "sweep": None}


def trained_place_network(
    trained: Mapping[str, Any], weights: Mapping[str, Tensor], model: str, file: Path, *, trust: bool = False
) -> TrainedPlaceNetwork:
    """The network of a run of place recognition.

    Args:
        trained: ``task``, ``config`` and ``spec``, as its checkpoint tells them.
        weights: of its module, by name.
        model: what tells it from other networks.
        file: that the weights come from, for messages.
        trust: build parts of the user's own that the config names.

    Raises:
        UserError: of another task, with a wrong config or code of the user's own in it, or weights that do not fit
            or are not finite.
    """
    if trained["task"] != "place_recognition":
        raise UserError(
            f"a network of task={trained['task']} gives no place descriptor", "Name a run of task=place_recognition."
        )
    raw, spec = {**trained["config"], **_OF_THE_RUN}, trained["spec"]
    trained_config(raw, trained["task"], trust=trust)

    def build(group: str, **arguments: Any) -> Any:
        try:
            return build_part(raw[group], **arguments)
        except (ImportError, TypeError, ValueError) as error:
            raise UserError(f"{group}: {raw[group].get('_target_')} cannot be built: {error}") from None

    network = place_network(raw, spec, build)
    own = {name.removeprefix(PREFIX): tensor for name, tensor in weights.items() if name.startswith(PREFIX)}
    require_finite(own, file)
    try:
        network.load_state_dict(own)
    except RuntimeError as error:
        raise UserError(f"the weights do not fit the network: {str(error).splitlines()[0]}") from None
    return TrainedPlaceNetwork(network, ImageSize(spec["height"], spec["width"], spec["channels"]), model)
