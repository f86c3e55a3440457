r"""The distance that a robot moves from image to image, estimated where there is no odometry.

Without odometry, the next motion is predicted from the previous ones. The pace is the median displacement, along the
heading, between the last estimates. Each displacement is weighted by the confidence of both estimates and by the mass
of the belief on the map. A camera that passes five images of the map between two of its own is thus followed as well as
one that passes one, and the pace survives uninformative images. The estimates of a lost filter scatter: there is no
pace as long as the interquartile range of displacements exceeds four spacings of the map plus the pace itself. This is
the constant-velocity model, with a velocity per step estimated from displacements.

How far a robot departs from its pace is estimated with it. In units of the standard deviation
:math:`\sigma_0` of a motion without a pace, with displacements of total weight n and interquartile range I, it is the
root of the posterior mean of a variance that has been seen to be 1 in one displacement before (a unit-information
prior),

.. math:: q^2 = \min\!\Big(1,\; \frac{1 + n\, (I / 1.349\, \sigma_0)^2}{1 + n}\Big) :

0.30 where ten displacements agree. With q = 1, one image that looks like another place takes the robot there.
"""

from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_between
from sextant.localization.constants import FEW, UNKNOWN, WINDOW

#: largest number of displacements; one from a fully confident filter has weight 1, and ``WINDOW`` is their total
MOST = 100
#: interquartile range of a standard normal distribution
NORMAL = 1.349


@dataclass(frozen=True)
class ConstantVelocity:
    """The displacements of r runs from one step to the next.

    Attributes:
        ways: the last displacements, in the unit of the map, the newest last.
        weights: their weights; 0 where there is none.

    Example:
        >>> pace, here = ConstantVelocity.none(1), torch.zeros(1, 3).double()
        >>> for way in (2.0, 2.1, -40.0, 1.9, 2.0):
        ...     there = torch.tensor([[way, 0.0, 0.0]], dtype=torch.float64)
        ...     pace = pace.updated(here, there, weight=torch.ones(1).double(), steps=torch.ones(1).double())
        >>> pace.along(spacing=1.0).tolist()
        [2.0]
    """

    ways: Float64[Tensor, "r m"]
    weights: Float64[Tensor, "r m"]

    @classmethod
    def none(cls, runs: int, device: torch.device | None = None) -> Self:
        """The state before the first displacement."""
        nothing = torch.zeros(runs, MOST, dtype=torch.float64, device=device)
        return cls(nothing, nothing)

    def along(self, spacing: float) -> Float64[Tensor, " r"]:
        """The weighted median of the displacements; nan while they are too few, or where they disagree.

        Args:
            spacing: spacing of the map.
        """
        middle, disagreement, _ = self._agreed(spacing)
        return torch.where(disagreement <= 1, middle, torch.nan)

    def departure(self, spacing: float) -> Float64[Tensor, " r"]:
        """q, how far a robot departs from the pace, as a share of how far it moves without one: 1 where there is none.

        Args:
            spacing: spacing of the map.

        >>> one, here, pace = torch.ones(1).double(), torch.zeros(1, 3).double(), ConstantVelocity.none(1)
        >>> for _ in range(5):
        ...     there = torch.tensor([[2.0, 0.0, 0.0]], dtype=torch.float64)
        ...     pace = pace.updated(here, there, weight=one, steps=one)
        >>> ConstantVelocity.none(1).departure(1.0).tolist(), pace.departure(1.0).round(decimals=2).tolist()
        ([1.0], [0.41])
        """
        _, _, spread = self._agreed(spacing)
        share, weight = spread / NORMAL / (UNKNOWN * spacing), self.weights.sum(1)
        departs = ((1 + weight * share.square()) / (1 + weight)).sqrt()
        return departs.nan_to_num(1.0).clamp(max=1.0).where(self.along(spacing).isfinite(), 1.0)

    def _agreed(self, spacing: float) -> tuple[Float64[Tensor, " r"], ...]:
        """The median, how far displacements disagree, and their interquartile range.

        Up to a disagreement of 1 they have a pace; it is infinite while they are too few.
        """
        ways, order = self.ways.where(self.weights > 0, torch.inf).sort(dim=1, stable=True)
        shares = self.weights.gather(1, order).cumsum(1)
        quarters = shares.new_tensor([0.25, 0.5, 0.75]).expand(len(shares), 3).contiguous()
        rows = torch.searchsorted(shares / shares[:, -1:], quarters).clamp(max=MOST - 1)
        first, middle, last = ways.gather(1, rows).unbind(1)
        disagreement = (last - first) / (2 * UNKNOWN * spacing + middle.abs())
        return middle, disagreement.where((self.weights > 0).sum(1) >= FEW, torch.inf), last - first

    def updated(
        self,
        before: Float64[Tensor, "r 3"],
        after: Float64[Tensor, "r 3"],
        weight: Float64[Tensor, " r"],
        steps: Float64[Tensor, " r"],
    ) -> Self:
        """The pace with the displacement between two estimated poses added.

        Args:
            before, after: the poses.
            weight: confidence in them, in [0, 1]; 0 adds nothing.
            steps: number of steps from one to the other.
        """
        way = se2_between(before, after)[:, 0] / steps
        counts = (way.isfinite() & (weight > 0))[:, None]
        ways = torch.cat([self.ways[:, 1:], way[:, None]], 1)
        weights = torch.cat([self.weights[:, 1:], weight[:, None]], 1)
        newer = torch.nn.functional.pad(weights.flip(1).cumsum(1)[:, :-1], (1, 0)).flip(1)
        weights = weights.where(newer < WINDOW, 0.0)
        return type(self)(torch.where(counts, ways, self.ways), torch.where(counts, weights, self.weights))
