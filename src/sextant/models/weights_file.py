"""Weights of a network from a file that somebody else wrote; nothing in it is executed."""

import pickle
import re
from pathlib import Path

from torch import nn

from sextant.errors import ArgumentError
from sextant.torch_file import load_verified, require_finite


def load_weights(network: nn.Module, path: Path) -> None:
    """Load a state dict of exactly this network, in place.

    Args:
        network: gets the weights.
        path: a ``.safetensors`` file, or what ``torch.save`` wrote of a state dict.

    Raises:
        ArgumentError: there is no such file, it holds anything but tensors, it is damaged, or they are those of another
            network or not finite.
    """
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            state = load_file(path)
        else:
            state = load_verified(path)
        network.load_state_dict(state)
        require_finite(state, path)
    except Exception as error:
        raise ArgumentError(
            f"weights={path} cannot be loaded: {why_unread(error)}",
            "Give a state dict of this network, as torchvision saves it.",
        ) from None


def why_unread(error: Exception) -> str:
    """Why torch did not read a file of weights, in one line, without its advice on how to run what the file holds."""
    lines = str(error).splitlines() or [type(error).__name__]
    if not isinstance(error, pickle.UnpicklingError):
        return lines[0]
    if (named := re.search(r"GLOBAL (\S+)", str(error))) is not None:
        return f"it would call {named[1]}"
    return "it holds more than tensors and plain containers"
