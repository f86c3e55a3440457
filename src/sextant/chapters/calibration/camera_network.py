"""The network of a calibration run, as a predictor of the cameras of images."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from sextant.chapters.calibration.network import CameraNetwork, network_parts
from sextant.config.building import build
from sextant.config.trained import without_weights
from sextant.errors import UserError
from sextant.kit.content import load_weights, own_config
from sextant.runs.checkpoint import KEY


def trained_camera_network(content: Mapping[str, Any], checkpoint: Path, *, trust: bool = False) -> CameraNetwork:
    """Load the network of a calibration run, in evaluation mode.

    Args:
        content: content of its checkpoint, from :func:`~sextant.kit.content.read_trained`.
        checkpoint: the checkpoint's file, for error messages.
        trust: build user-defined parts that the config names.

    Raises:
        UserError: the run is of another task, its config is wrong or names user-defined code, or the weights do not
            fit or are not finite.
    """
    trained = content[KEY]
    if trained["task"] != "calibration":
        raise UserError(
            f"{checkpoint} is a model of {trained['task']}, not of calibration", "Name a run of task=calibration."
        )
    plain = without_weights(own_config(trained, trust=trust)).plain
    network = CameraNetwork(*network_parts(plain, trained["spec"], partial(build, plain)))
    # leave out what belongs to training alone: the state of a loss
    own = {name: value for name, value in content["state_dict"].items() if not name.startswith("loss.")}
    load_weights(network, {"state_dict": own}, checkpoint)
    return network.eval()
