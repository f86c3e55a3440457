"""How particles move where nothing measures the motion but the pace of the drive is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_exp
from sextant.localization.motion.model import MotionModel

#: one particle in so many does not keep the pace, or in so many where there is none
ONE_IN, ONE_IN_UNPACED = 4, 2
#: it spreads along, and turns, by so many times the deviations of a motion that is unknown
FURTHER = 4.0


@dataclass(frozen=True)
class PacedMotion(MotionModel):
    r"""As ``measured`` where motion is known; where it is unknown, three in four particles keep a pace.

    .. math:: x_t = x_{t-1} \circ \exp\big((v, 0, 0) + \epsilon\big), \quad\text{and in each fourth}\quad
       x_t = x_{t-1} \circ \exp\big(\mathrm{diag}(4, 1, 4)\,\epsilon\big),

    with v the pace and ε of the deviations of ``measured.if_unknown()``: robots mostly go on as they went, and the
    others are there for one that turns a corner, stops, turns back or drives faster than any particle knew. As long as
    there is no pace, v is 0 and half of the particles are such others.

    Args:
        measured: of motions that are known, and the deviations of those that are not.
        pace: along, from one step to the next, in the unit of the map, :class:`~sextant.localization.pace.Pace`; None
            if it is not known.

    Example:
        >>> from sextant.localization.motion import ExponentialMotion
        >>> model = PacedMotion(ExponentialMotion((0.1, 0.0, 0.0), unknown=(0.0, 0.0, 0.0)), pace=2.0)
        >>> unknown = torch.full((1, 3), torch.nan).double()
        >>> model.sample(torch.zeros(1, 4, 3).double(), unknown, torch.Generator())[0, :, 0].tolist()
        [0.0, 2.0, 2.0, 2.0]
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
        """The first, fifth, ninth particle of each run does not keep the pace."""
        twist = noise * noise.new_tensor(self.if_unknown())
        number = torch.arange(noise.shape[1], device=noise.device)
        elsewhere = (number % (ONE_IN_UNPACED if self.pace is None else ONE_IN) == 0)[:, None]
        kept = twist + twist.new_tensor([self.pace or 0.0, 0.0, 0.0])
        return se2_exp(torch.where(elsewhere, twist * twist.new_tensor([FURTHER, 1.0, FURTHER]), kept))
