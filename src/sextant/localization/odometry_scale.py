r"""Odometry scale: the relative error common to all steps of odometry, estimated while driving.

Worn tyres make every distance too long, and a single camera measures its own motion only up to scale. A filter that
treats errors as independent falls behind such odometry: its estimates repeatedly move farther than predicted, or less
far. So the factor s by which odometry is multiplied follows the remaining error,

.. math:: s \leftarrow s \, \big(1 + \kappa\, [e]_{-1}^{1}\big), \qquad
   e = \frac{(d - s\,u) \cdot s\,u}{\|s\,u\|\, \max(\|s\,u\|, \Delta)},

with u the translation that odometry reports, d the translation between the estimates before and after the step, both in
the robot's frame before it, and Δ the spacing of the map. This is an integral controller, which is at rest where
estimates move as far as scaled odometry. A. Martinelli, N. Tomatis, R. Siegwart, "Simultaneous localization and
odometry self calibration for mobile robot", Autonomous Robots 22, 2007, estimate such errors as part of the state
instead; particles would then need another dimension.

κ is 1/20. Estimates farther than two spacings from the expected pose are at another place, and teach nothing
(results/localization_change.md, "When odometry is wrong").
"""

from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose, se2_inverse
from sextant.localization.constants import FURTHER, RECENT, UNKNOWN


@dataclass(frozen=True)
class OdometryScale:
    """The factors by which the odometry of r runs is multiplied.

    Attributes:
        factor: s.

    Example:
        >>> scale, here = OdometryScale.none(1), torch.zeros(1, 3).double()
        >>> for _ in range(100):  # odometry reports a metre each time, and it is 1.25 m
        ...     told = scale.applied(torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64))
        ...     scale = scale.updated(told, here, torch.tensor([[1.25, 0.0, 0.0]], dtype=torch.float64), spacing=1.0)
        >>> scale.factor.round(decimals=2).tolist()
        [1.25]
    """

    factor: Float64[Tensor, " r"]

    @classmethod
    def none(cls, runs: int, device: torch.device | None = None) -> Self:
        """No error."""
        return cls(torch.ones(runs, dtype=torch.float64, device=device))

    def applied(self, motion: Float64[Tensor, "r 3"]) -> Float64[Tensor, "r 3"]:
        """The corrected motion: its translation is scaled, its rotation is not."""
        return torch.cat([self.factor[:, None] * motion[:, :2], motion[:, 2:]], 1)

    def updated(
        self,
        moved: Float64[Tensor, "r 3"],
        before: Float64[Tensor, "r 3"],
        after: Float64[Tensor, "r 3"],
        spacing: float,
    ) -> Self:
        """The scale after one more step.

        Args:
            moved: s u, the motion as it was applied.
            before, after: estimated poses before and after the step.
            spacing: spacing of the map.
        """
        way = moved[:, :2]
        length = way.norm(dim=1)
        left = se2_compose(se2_inverse(before), after)[:, :2] - way
        error = (left * way).sum(1) / (length * length.clamp(min=spacing))
        factor = (self.factor * (1 + error.clamp(-1.0, 1.0) / RECENT)).clamp(1 / FURTHER, FURTHER)
        near = (length > 0) & (left.norm(dim=1) < UNKNOWN * spacing)  # nan is not
        return type(self)(torch.where(near, factor, self.factor))
