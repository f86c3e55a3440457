"""The interface of every loss of a predicted camera to the task that trains with it."""

from abc import abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.geometry import ParameterSpace


class CameraLoss(nn.Module):
    """A loss between predicted and true cameras in the numbers of one parameterization.

    Args:
        space: the parameterization and its ranges.
    """

    def __init__(self, space: ParameterSpace):
        super().__init__()
        self.space = space

    @abstractmethod
    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Loss of each image; ``aspect`` is width over height."""


def at_least_single(*values: Tensor) -> tuple[Tensor, ...]:
    """Values in float32 or wider: a network's outputs in half precision are compared in single precision."""
    return tuple(value.to(torch.promote_types(value.dtype, torch.float32)) for value in values)
