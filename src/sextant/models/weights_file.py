"""Weights of a network from a third-party file; nothing in it is executed."""

import pickle
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torch import nn

from sextant.errors import ArgumentError, UserError
from sextant.torch_file import load_verified, require_finite


def load_weights(
    network: nn.Module, path: Path, adapt: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
) -> None:
    """Load a state dict of exactly this network, in place.

    Args:
        network: the network that gets the weights.
        path: a ``.safetensors`` file, or a state dict written by ``torch.save``.
        adapt: changes a state dict that does not fit.

    Raises:
        ArgumentError: the file does not exist, is damaged, or holds anything but tensors; or the tensors are those of
            another network or not finite.
    """
    try:
        state: Mapping[str, Any] = _content(path)
        if adapt is not None and _misfits(network, state):
            state = adapt(state)
        _require_fit(network, state)
        network.load_state_dict(state)
        require_finite(state, path)
    except Exception as error:
        raise ArgumentError(
            f"weights={path} cannot be loaded: {why_unread(error)}",
            "Give a state dict of this network, as torchvision saves it.",
        ) from None


def read_weights(path: Path, told: str, usage: str) -> Any:
    """The content of a file of weights: tensors and plain containers. Nothing in it is executed.

    Args:
        path: a ``.safetensors`` file, or one written by ``torch.save``.
        told: the argument that names it, for messages.
        usage: what to give, for the message that there is no such file.

    Raises:
        UserError: the file is missing, damaged, or holds anything else.
    """
    try:
        return _content(path)
    except FileNotFoundError:
        raise UserError(f"{told}: there is no such file", usage) from None
    except UserError:
        raise
    except Exception as error:  # a damaged file can fail in any way
        raise UserError(
            f"{told} cannot be read; nothing in it was executed: {why_unread(error)}",
            f"It may be truncated. {usage}",
        ) from None


def _content(path: Path) -> Any:
    if path.suffix == ".safetensors":
        from safetensors.torch import load_file

        return load_file(path)
    return load_verified(path)


def fit_weights(network: nn.Module, state: Mapping[str, Any], told: str) -> None:
    """Load a state dict that was read, in place; counters of batch normalisation may be missing in it.

    Args:
        network: the network that gets the weights.
        state: the weights by name.
        told: what they are of, for the message.

    Raises:
        UserError: the weights are those of another network.
    """
    counters = {key: value for key, value in network.state_dict().items() if key.endswith(".num_batches_tracked")}
    try:
        _require_fit(network, whole := {**counters, **state})
    except ValueError as error:
        raise UserError(f"{told} cannot be used: {error}", "Give the file of exactly this network.") from None
    network.load_state_dict(whole)


def _require_fit(network: nn.Module, state: Mapping[str, Any]) -> None:
    """Raise a ``ValueError`` that names the first keys of a state dict that are not those of the network."""
    if told := _misfits(network, state):
        raise ValueError(f"it does not fit {type(network).__name__}: {'; '.join(told)}")


def _misfits(network: nn.Module, state: Mapping[str, Any]) -> list[str]:
    own = network.state_dict()
    wrong = {
        "lacks": [key for key in own if key not in state],
        "also holds": [key for key in state if key not in own],
        "has in another shape": [k for k in own if k in state and own[k].shape != getattr(state[k], "shape", None)],
    }
    return [f"it {how} {', '.join(keys[:3])} ({len(keys)} in all)" for how, keys in wrong.items() if keys]


def why_unread(error: Exception) -> str:
    """The reason why torch refused a file of weights, in one line, without its advice on how to execute the content.

    >>> why_unread(EOFError()), why_unread(KeyError(101))  # an empty file, a text
    ('it was not written by torch.save', 'it was not written by torch.save')
    """
    said = str(error)
    no_opcode = "Unsupported operand" in said or (
        isinstance(error, KeyError) and isinstance(next(iter(error.args), None), int)
    )
    if isinstance(error, EOFError) or no_opcode:
        return "it was not written by torch.save"
    if isinstance(error, pickle.UnpicklingError):
        if (named := re.search(r"GLOBAL (\S+)", said)) is not None:
            return f"it would call {named[1]}"
        return "it holds more than tensors and plain containers"
    return next(filter(None, map(str.strip, said.splitlines())), type(error).__name__)
