"""The network of a run of calibration, as what predicts the cameras of images."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from sextant.config.building import build
from sextant.config.trained import without_weights
from sextant.errors import UserError
from sextant.runs.checkpoint import KEY
from sextant.tasks.calibration.network import CameraNetwork, network_parts
from sextant.trained.content import load_weights, own_config


def trained_camera_network(content: Mapping[str, Any], checkpoint: Path, *, trust: bool = False) -> CameraNetwork:
    """The network of a run of calibration, in evaluation mode.

    Args:
        content: of its checkpoint, by :func:`~sextant.trained.content.read_trained`.
        checkpoint: its file, for messages.
        trust: build parts of the user's own that the config names.

    Raises:
        UserError: of another task, with a wrong config or code of the user's own in it, or weights that do not fit
            or are not finite.
    """
    trained = content[KEY]
    if trained["task"] != "calibration":
        raise UserError(
            f"{checkpoint} is a model of {trained['task']}, not of calibration", "Name a run of task=calibration."
        )
    plain = without_weights(own_config(trained, trust=trust)).plain
    network = CameraNetwork(*network_parts(plain, trained["spec"], partial(build, plain)))
    # what belongs to training alone is left out: the state of a loss
    own = {name: value for name, value in content["state_dict"].items() if not name.startswith("loss.")}
    load_weights(network, {"state_dict": own}, checkpoint)
    return network.eval()
