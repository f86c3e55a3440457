"""The motion model of a robot that does not move."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.localization.motion.model import MotionModel


@dataclass(frozen=True)
class IdentityMotion(MotionModel):
    """:math:`x_t = x_{t-1}`, whatever odometry says. There is no noise, so particles never spread.

    Example:
        >>> poses, metre = torch.ones(1, 1, 3).double(), torch.tensor([[1.0, 0.0, 0.0]]).double()
        >>> IdentityMotion().sample(poses, metre, torch.Generator())
        tensor([[[1., 1., 1.]]], dtype=torch.float64)
    """

    def if_unknown(self) -> Sequence[float]:
        """No motion."""
        return (0.0, 0.0, 0.0)

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r 1 3"]:
        """No motion."""
        return torch.zeros_like(motion)[:, None]
