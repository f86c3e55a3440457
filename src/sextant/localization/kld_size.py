r"""KLD-sampling: the number of particles adapts to the width of the belief.

.. math:: n = \frac{k-1}{2\varepsilon} \Big\{1 - \frac{2}{9(k-1)} + \sqrt{\frac{2}{9(k-1)}}\, z_{1-\delta}\Big\}^3

particles keep the Kullback-Leibler divergence between their histogram over k occupied boxes and the distribution they
are drawn from below :math:`\varepsilon` with probability :math:`1-\delta`. The bracket is Wilson and Hilferty's
approximation of a quantile of :math:`\chi^2_{k-1}`.

Source: D. Fox, "Adapting the Sample Size in Particle Filters Through KLD-Sampling", IJRR 2003. There k grows while
particles are drawn; here k is counted after one resampling of the current particles, so that all runs are drawn at
once.
"""

import math
from dataclasses import dataclass, field
from statistics import NormalDist

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.ranges import Count, NonNegative, Positive, Share, checked


@dataclass(frozen=True)
class PoseBins:
    """Boxes of a grid in x, y and heading.

    Attributes:
        position: side of a box in metres.
        heading: desired width in rad; the width used divides the circle into whole boxes, at least one.

    Example:
        >>> import torch
        >>> bins = PoseBins(position=1.0, heading=math.radians(90))
        >>> poses = torch.tensor([[[0.2, 0.5, 0.1], [0.7, 0.1, 0.1 + 2 * math.pi], [-0.1, 0.5, 0.1]]]).double()
        >>> bins.cells(poses).tolist(), bins.occupied(poses).tolist()  # headings a turn apart are the same
        ([[[0, 0, 0], [0, 0, 0], [-1, 0, 0]]], [2])
    """

    position: float
    heading: float

    @property
    def turns(self) -> int:
        """The number of boxes around the circle."""
        return max(1, round(2 * math.pi / self.heading))

    def cells(self, poses: Float64[Tensor, "r p 3"]) -> Int64[Tensor, "r p 3"]:
        """The box of each pose: column, row, and heading from 0 to ``turns - 1``."""
        scale = poses.new_tensor([1 / self.position, 1 / self.position, self.turns / (2 * math.pi)])
        cells = (poses * scale).floor().long()
        cells[..., 2].remainder_(self.turns)
        return cells

    def keys(self, cells: Int64[Tensor, "r p 3"]) -> Int64[Tensor, "r p"]:
        """One number for each box, the same in all runs."""
        column, row, heading = (cells - cells.amin((0, 1))).unbind(2)
        return (column * (row.max() + 1) + row) * self.turns + heading

    def occupied(self, poses: Float64[Tensor, "r p 3"]) -> Int64[Tensor, "r"]:
        """The number of boxes that the poses of each run occupy."""
        ordered = self.keys(self.cells(poses)).sort(1).values
        return 1 + (ordered[:, 1:] != ordered[:, :-1]).sum(1)


@checked
@dataclass(frozen=True)
class KLDSize:
    r"""How many particles a run needs.

    Attributes:
        epsilon: the largest divergence, in nats.
        delta: probability that the divergence is larger.
        minimum: smallest number of particles of a run.
        maximum: largest number of particles of a run.
        position_bin: side of a box in metres.
        heading_bin_rad: width of a box in heading, in rad.
        tolerance: a run is resampled to its new size only if the size changes by more than this share.

    Raises:
        ArgumentError: an argument is outside its allowed range.

    Example:
        >>> size = KLDSize(minimum=100, maximum=10_000)
        >>> size.wanted(torch.tensor([1, 100, 10_000])).tolist()  # for these numbers of occupied boxes
        [100, 1347, 10000]
        >>> size.for_poses(torch.zeros(1, 5000, 3, dtype=torch.float64))  # all in one place: few are enough
        tensor([100])
    """

    epsilon: Positive = 0.05
    delta: Share = 0.01
    minimum: Count = 100
    maximum: Count = 10_000
    position_bin: Positive = 0.5
    heading_bin_rad: Positive = field(default=math.radians(10))
    tolerance: NonNegative = 0.2

    def __post_init__(self) -> None:
        if self.minimum > self.maximum:
            raise ArgumentError(
                f"minimum={self.minimum} must be at most maximum={self.maximum}",
                "For example minimum=100 maximum=10000",
                of=self,
            )

    def wanted(self, occupied: Int64[Tensor, "r"]) -> Int64[Tensor, "r"]:
        """The number of particles for k occupied boxes, between minimum and maximum."""
        degrees = (occupied - 1).clamp(min=1).double()
        ninth = 2 / (9 * degrees)
        quantile = degrees * (1 - ninth + ninth.sqrt() * NormalDist().inv_cdf(1 - self.delta)) ** 3
        size = torch.where(occupied > 1, (quantile / (2 * self.epsilon)).ceil(), 0.0)
        return size.long().clamp(self.minimum, self.maximum)

    def for_poses(self, poses: Float64[Tensor, "r p 3"]) -> Int64[Tensor, "r"]:
        """The number of particles for each run, given draws from its belief."""
        return self.wanted(PoseBins(self.position_bin, self.heading_bin_rad).occupied(poses))
