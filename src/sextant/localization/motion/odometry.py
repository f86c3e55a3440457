r"""Odometry as a rotation, a translation and a second rotation, each with its own noise.

.. math:: \hat\delta_{1} &= \delta_{1} + \mathcal N(0, \alpha_1 \delta_1^2 + \alpha_2 d^2) \\
   \hat d &= d + \mathcal N(0, \alpha_3 d^2 + \alpha_4 (\delta_1^2 + \delta_2^2)) \\
   \hat\delta_{2} &= \delta_{2} + \mathcal N(0, \alpha_1 \delta_2^2 + \alpha_2 d^2)

Source: Thrun, Burgard & Fox, "Probabilistic Robotics", MIT Press 2005, table 5.6, with the robot's frame as the origin.
The table leaves two cases open. A robot that drives backwards has not turned round first: the first rotation is folded
into [-π/2, π/2], and d is then negative. Where the robot hardly moves, the direction is noise: in the variances the
first rotation then counts as zero, and the second as the whole turn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import wrap_angle
from sextant.localization.motion.model import MotionModel, check_not_negative


@dataclass(frozen=True)
class OdometryMotion(MotionModel):
    """The odometry model with four alphas; noiseless when they are 0.

    Args:
        alphas: variance of rotation by rotation, of rotation by translation (rad²/m²), of translation by translation,
            of translation by rotation (m²/rad²).
        least_translation: distance in metres below which the direction of a motion is treated as noise.
        unknown: standard deviations along, across and in heading where odometry is missing.

    Raises:
        UserError: a value is negative or not finite, or an argument has the wrong number of values.

    Example:
        >>> exact, motion = OdometryMotion(alphas=(0.0, 0.0, 0.0, 0.0)), torch.tensor([[-1.0, 0.0, 0.0]]).double()
        >>> exact.sample(torch.zeros(1, 1, 3).double(), motion, torch.Generator())  # a metre backwards
        tensor([[[-1.,  0.,  0.]]], dtype=torch.float64)
    """

    alphas: tuple[float, float, float, float] = (0.2, 0.2, 0.2, 0.2)
    least_translation: float = 0.01
    unknown: tuple[float, float, float] = (0.5, 0.2, 0.2)

    def __post_init__(self) -> None:
        check_not_negative("alphas", self.alphas, 4)
        check_not_negative("least_translation", [self.least_translation], 1)
        check_not_negative("unknown", self.unknown, 3)

    def if_unknown(self) -> Sequence[float]:
        """``unknown``."""
        return self.unknown

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """The motion with noise on each of its three parts."""
        first, way, second = _parts(motion)
        small = way.abs() < self.least_translation
        turned = torch.where(small, 0.0, first)
        turned_after = torch.where(small, motion[:, 2], second)
        a1, a2, a3, a4 = self.alphas
        variances = torch.stack(
            [
                a1 * turned**2 + a2 * way**2,
                a3 * way**2 + a4 * (turned**2 + turned_after**2),
                a1 * turned_after**2 + a2 * way**2,
            ],
            dim=1,
        )
        parts = torch.stack([first, way, second], dim=1)[:, None] + noise * variances.sqrt()[:, None]
        first, way, second = parts.unbind(2)
        return torch.stack([way * first.cos(), way * first.sin(), wrap_angle(first + second)], dim=2)


def _parts(motion: Float64[Tensor, "r 3"]) -> tuple[Tensor, Tensor, Tensor]:
    direction = torch.atan2(motion[:, 1], motion[:, 0])
    back = direction.abs() > math.pi / 2
    first = torch.where(back, wrap_angle(direction + math.pi), direction)
    way = motion[:, :2].norm(dim=1)
    return first, torch.where(back, -way, way), wrap_angle(motion[:, 2] - first)
