"""Loads the networks published by the push-pull paper's authors into networks of this package.

A file is a legacy torch pickle of ``{epoch, state_dict, best_prec1}``. It names neither the architecture nor the
inhibition, but its keys and shapes reveal both: a convolution stored as ``conv1.push.weight`` is a push-pull layer. Its
h and α are not stored; the authors' training script never changes them from 2 and 1, in a layer without bias.

Source: https://github.com/nicstrisc/Push-Pull-CNN-layer, folder ``models``, MIT licence.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers import PushPullConv2d
from sextant.models.densenet_cifar import DenseNetCifar
from sextant.models.published_arrays import number_of
from sextant.models.resnet_cifar import ResNetCifar
from sextant.models.weights_file import read_weights
from sextant.torch_file import require_finite

IMAGE_SIZE = (32, 32)
FIX = "Give a checkpoint.pth.tar or model_best.pth.tar of https://github.com/nicstrisc/Push-Pull-CNN-layer."


@dataclass(frozen=True)
class PublishedCheckpoint:
    """A published network and the facts in its file.

    Attributes:
        network: in evaluation mode; takes images in [0, 1].
        architecture: such as ``resnet-20`` or ``densenet-40-12``.
        push_pull: paths of its push-pull layers.
        epoch: training epoch after which it was saved, counted from 1.
        best_accuracy: test accuracy of the run's best epoch so far: this network's own in ``model_best``, that of
            another epoch in ``checkpoint``.
    """

    network: nn.Module
    architecture: str
    push_pull: tuple[str, ...]
    epoch: int
    best_accuracy: float


def load_published(path: Path, *, scale: float = 2.0, alpha: float = 1.0, content: Any = None) -> PublishedCheckpoint:
    """Read one of the authors' files on the CPU. Nothing in it is executed: only tensors and containers are accepted.

    Args:
        scale, alpha: h and α of its push-pull layers, which the file does not store.
        content: of the file, if it has been read.

    Raises:
        UserError: the file is missing, truncated, not the authors', a network of another kind or depth, or its weights
            are not finite.

    >>> import torch
    >>> from tempfile import TemporaryDirectory
    >>> state = ResNetCifar(3, IMAGE_SIZE, 10, depth=20).state_dict()
    >>> state["conv1.push.weight"] = state.pop("conv1.weight")  # how they store a push-pull layer
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "model_best.pth.tar")
    ...     torch.save({"epoch": 7, "state_dict": state, "best_prec1": 91.7}, file)
    ...     found = load_published(file)
    >>> found.architecture, found.push_pull
    ('resnet-20', ('conv1',))
    """
    content = _checked(path, read_weights(path, str(path), FIX) if content is None else content)
    state = {name.removeprefix("module."): tensor for name, tensor in content["state_dict"].items()}
    push_pull = tuple(name.removesuffix(".push.weight") for name in state if name.endswith(".push.weight"))
    state = {re.sub(r"\.push\.(weight|bias)$", r".\1", name): tensor for name, tensor in state.items()}
    architecture, network = _build(path, state)
    try:
        network.load_state_dict(state)
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:300]
        raise UserError(f"{path} looks like {architecture} but does not fit it: {reason}", FIX) from None
    for name in push_pull:
        conv = network.get_submodule(name)
        assert isinstance(conv, nn.Conv2d)
        network.set_submodule(name, PushPullConv2d.from_conv(conv, scale=scale, alpha=alpha))
    return PublishedCheckpoint(
        network.eval(), architecture, push_pull, int(content["epoch"]), float(content["best_prec1"]) / 100
    )


def _checked(path: Path, content: Any) -> dict[str, Any]:
    if not isinstance(content, dict) or not {"epoch", "state_dict", "best_prec1"} <= set(content):
        raise UserError(f"{path} is not a published network: it should hold epoch, state_dict and best_prec1", FIX)
    state = content["state_dict"]
    if not isinstance(state, Mapping) or not all(isinstance(value, Tensor) for value in state.values()):
        raise UserError(f"{path} is not a published network: its state_dict is not a mapping of tensors", FIX)
    require_finite(state, path)
    for key in ("epoch", "best_prec1"):
        value = content[key]
        if not isinstance(value, int | float) and not (isinstance(value, Tensor) and value.numel() == 1):
            raise UserError(f"{path} is not a published network: {key} is not a number", FIX)
    return content


def _build(path: Path, state: Mapping[str, Tensor]) -> tuple[str, nn.Module]:
    try:
        if "fc.weight" in state:
            channels, classes = state["conv1.weight"].shape[1], len(state["fc.weight"])
            depth = 6 * number_of(state, r"layer1\.\d+\.conv1\.weight") + 2
            return f"resnet-{depth}", ResNetCifar(channels, IMAGE_SIZE, classes, depth=depth)
        channels, classes = state["features.conv0.weight"].shape[1], len(state["classifier.weight"])
        depth = 6 * number_of(state, r"features\.denseblock1\.denselayer\d+\.conv1\.weight") + 4
        growth = len(state["features.denseblock1.denselayer1.conv2.weight"])
        return f"densenet-{depth}-{growth}", DenseNetCifar(channels, IMAGE_SIZE, classes, depth=depth, growth=growth)
    except (KeyError, IndexError, TypeError) as error:
        raise UserError(f"{path} is neither a ResNet nor a DenseNet of the paper: it has no {error}", FIX) from None
    except ValueError as error:
        raise UserError(f"{path} is not a network of the paper: {error}", FIX) from None
