"""How particles move where nothing measures the motion but the pace of the drive is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_exp
from sextant.localization.motion.model import MotionModel

#: one particle in so many spreads further along, or in so many where there is no pace, and one in so many turns wider
FURTHER_ONE_IN, UNPACED_ONE_IN, TURNING_ONE_IN = 4, 2, 4
#: by so many times the deviations of a motion that is unknown
FURTHER = 4.0


@dataclass(frozen=True)
class PacedMotion(MotionModel):
    r"""As ``measured`` where motion is known; where it is unknown, three in four particles keep a pace.

    .. math:: x_t = x_{t-1} \circ \exp\big((v, 0, 0) + D\,\epsilon\big),

    with v the pace and ε of the deviations of ``measured.if_unknown()``. Robots mostly go on as they went: D = I. One
    particle in four has D = diag(1, 1, 4), for a robot that turns a corner; another has v = 0 and D = diag(4, 1, 1),
    for one that stops, turns back or drives faster than any particle knew. As long as there is no pace, v = 0, and half
    of the particles are as that last one. A particle keeps its part until it is resampled. What does not err along does
    not move of itself either.

    Args:
        measured: of motions that are known, and the deviations of those that are not.
        pace: along, from one step to the next, in the unit of the map, :class:`~sextant.localization.pace.Pace`; None
            if it is not known.

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
        """Those of ``measured``."""
        return self.measured.if_unknown()

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "#r #p 3"]:
        """Those of ``measured``."""
        return self.measured.increments(motion, noise)

    def unmeasured(self, noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """Of every four particles the last spreads further, the third turns wider."""
        deviations = noise.new_tensor(self.if_unknown())
        twist = noise * deviations
        kept = twist.new_tensor([(self.pace or 0.0) if deviations[0] > 0 else 0.0, 0.0, 0.0])
        number = torch.arange(noise.shape[1], device=noise.device)[:, None]
        one_in = UNPACED_ONE_IN if self.pace is None else FURTHER_ONE_IN
        further, turning = number % one_in == one_in - 1, number % TURNING_ONE_IN == 2
        turned = torch.where(turning, twist * twist.new_tensor([1.0, 1.0, FURTHER]), twist)
        return se2_exp(torch.where(further, twist * twist.new_tensor([FURTHER, 1.0, 1.0]), turned + kept))
