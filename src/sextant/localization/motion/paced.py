"""A motion model for drives whose pace is known but whose motion is not measured."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_exp
from sextant.localization.motion.model import MotionModel

#: one particle in this many spreads further along with a pace, one in this many without, and one in this many turns
#: wider
FURTHER_ONE_IN, UNPACED_ONE_IN, TURNING_ONE_IN = 4, 2, 4
#: factor of the standard deviations of an unknown motion for these particles
FURTHER = 4.0


@dataclass(frozen=True)
class PacedMotion(MotionModel):
    r"""Moves as ``measured`` where motion is known; where it is unknown, three in four particles keep the pace.

    .. math:: x_t = x_{t-1} \circ \exp\big((v, 0, 0) + D\,\epsilon\big),

    where v is the pace and ε has the standard deviations ``measured.if_unknown()``. Robots mostly go on as before:
    D = I. One particle in four has D = diag(1, 1, 4), for a robot that turns a corner. Another has v = 0 and
    D = diag(4, 1, 1), for a robot that stops, turns back or drives faster than any particle expected. Without a pace
    v = 0, and half of the particles behave like the latter. A particle keeps its role until it is resampled. A model
    without noise along the heading gets no pace either.

    Args:
        measured: model of known motions, and of the standard deviations of unknown ones.
        pace: distance along the heading from one step to the next, in the unit of the map
            (:class:`~sextant.localization.pace.Pace`); None if it is not known.

    Example:
        >>> from sextant.localization.motion import ExponentialMotion
        >>> model = PacedMotion(ExponentialMotion((0.1, 0.0, 0.0), unknown=(1e-9, 0.0, 0.0)), pace=2.0)
        >>> unknown = torch.full((1, 3), torch.nan).double()
        >>> model.sample(torch.zeros(1, 4, 3).double(), unknown, torch.Generator())[0, :, 0].round().abs().tolist()
        [2.0, 2.0, 2.0, 0.0]
    """

    measured: MotionModel
    pace: float | None

    def if_unknown(self) -> Sequence[float]:
        """The standard deviations of ``measured``."""
        return self.measured.if_unknown()

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "#r #p 3"]:
        """The increments of ``measured``."""
        return self.measured.increments(motion, noise)

    def unmeasured(self, noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """Of every four particles, the last spreads further and the third turns wider."""
        deviations = noise.new_tensor(self.if_unknown())
        twist = noise * deviations
        kept = twist.new_tensor([(self.pace or 0.0) if deviations[0] > 0 else 0.0, 0.0, 0.0])
        number = torch.arange(noise.shape[1], device=noise.device)[:, None]
        one_in = UNPACED_ONE_IN if self.pace is None else FURTHER_ONE_IN
        further, turning = number % one_in == one_in - 1, number % TURNING_ONE_IN == 2
        turned = torch.where(turning, twist * twist.new_tensor([1.0, 1.0, FURTHER]), twist)
        return se2_exp(torch.where(further, twist * twist.new_tensor([FURTHER, 1.0, 1.0]), turned + kept))
