"""Gaussian noise in the tangent space at the motion that odometry reports."""

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose, se2_exp
from sextant.localization.motion.model import MotionModel, check_not_negative

#: The noise of an unknown motion, in multiples of the noise of a step.
STEPS_IF_UNKNOWN = 20.0


@dataclass(frozen=True)
class ExponentialMotion(MotionModel):
    r""":math:`x_t = x_{t-1} \circ u_t \circ \exp(\epsilon)`, :math:`\epsilon \sim \mathcal N(0, \mathrm{diag}(v))`, and

    .. math:: v = \sigma_{step}^2 + |t|\, v_{metre} + |\theta|\, v_{radian}

    for a motion :math:`u = (t, \theta)`. The noise grows like a random walk with the distance and with the turn.

    Args:
        per_step: standard deviations along, across (metres) and in heading (rad), however small the motion.
        per_metre: variances for each metre travelled.
        per_radian: variances for each radian turned.
        unknown: standard deviations where odometry is missing; None for twenty times ``per_step``. Then what cannot err
            with odometry cannot err without it either: a train stays on its line.

    Raises:
        UserError: an argument is not three finite numbers of at least 0.

    Example:
        >>> import torch
        >>> model = ExponentialMotion(per_step=(0.0, 0.0, 0.0), per_metre=(0.04, 0.0, 0.0))
        >>> poses, metre = torch.zeros(1, 1000, 3).double(), torch.tensor([[1.0, 0.0, 0.0]]).double()
        >>> moved = model.sample(poses, metre, torch.Generator().manual_seed(0))
        >>> round(moved[0, :, 0].std().item(), 2)  # along, after one metre: sqrt(0.04)
        0.2
    """

    per_step: tuple[float, float, float] = (0.025, 0.01, 0.015)
    per_metre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    per_radian: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unknown: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("per_step", "per_metre", "per_radian"):
            check_not_negative(name, getattr(self, name), 3)
        check_not_negative("unknown", self.if_unknown(), 3)

    def if_unknown(self) -> Sequence[float]:
        """``unknown``, or twenty times ``per_step``."""
        return [STEPS_IF_UNKNOWN * sigma for sigma in self.per_step] if self.unknown is None else self.unknown

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """:math:`u \\circ \\exp(\\epsilon)`."""
        way, turn = motion[:, :2].norm(dim=1), motion[:, 2].abs()
        variance = (
            motion.new_tensor(self.per_step).square()
            + way[:, None] * motion.new_tensor(self.per_metre)
            + turn[:, None] * motion.new_tensor(self.per_radian)
        )
        return se2_compose(motion[:, None], se2_exp(noise * variance.sqrt()[:, None]))
