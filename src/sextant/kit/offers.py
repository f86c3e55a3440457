"""What trained models offer other programs: a network from tensors to tensors, predictions for single photos."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn

from sextant.errors import UserError

Kind = Literal["string", "double", "doubles"]
Row = dict[str, Any]
#: column of every table: why a photo has no prediction; empty if it has one
ERROR = "error"


@dataclass(frozen=True)
class PhotoPredictor:
    """A trained model that predicts from single photos.

    Attributes:
        columns: columns of the prediction and their types: strings, numbers or lists of numbers.
        answer: returns rows for photos of any kind and size, in order; columns without a value are left out.
    """

    columns: Mapping[str, Kind]
    answer: Callable[[Sequence[Path]], list[Row]]

    def predict(self, photos: Sequence[Path]) -> list[Row]:
        """A row with all columns for each photo, None where there is no value, and the column ``error``."""
        missing: Row = dict.fromkeys(self.columns)
        return [{**missing, ERROR: "", **row} for row in self.answer(photos)]


def failed_row(error: UserError) -> Row:
    """The row of a photo without a prediction."""
    return {ERROR: error.problem}


@dataclass(frozen=True)
class Exportable:
    """A network with its inputs and outputs; the first dimension of each is the batch.

    Attributes:
        network: takes the inputs by name, and returns a tensor, or a tuple with one tensor per output.
        inputs: an example of each input, with a batch of two.
        meanings: descriptions of the inputs and then the outputs, in order.
    """

    network: nn.Module
    inputs: Mapping[str, Tensor]
    meanings: Mapping[str, str]

    @property
    def outputs(self) -> list[str]:
        """The names of the outputs."""
        return [name for name in self.meanings if name not in self.inputs]


class Named(nn.Module):
    """A network whose single input has the name used in exports."""

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> Tensor:
        """The network's output."""
        found: Tensor = self.network(images)
        return found


def example_images(spec: Mapping[str, Any], channels: int | None = None) -> Tensor:
    """Two images as a network takes them; ``channels`` in place of those of its spec."""
    return torch.rand(2, channels or spec["channels"], spec["height"], spec["width"])


def image_meaning(spec: Mapping[str, Any], channels: int) -> str:
    """The shape, kind and range of such images, in words."""
    kind = {1: "grey", 3: "RGB"}.get(channels, f"{channels} channels")
    return f"(b, {channels}, {spec['height']}, {spec['width']}), {kind}, from 0 to 1"
