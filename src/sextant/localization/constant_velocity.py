r"""The distance that a robot moves from image to image, estimated where there is no odometry.

Without odometry, the next motion is predicted from the previous ones. The pace is the median displacement, along the
heading, between the last estimates. Each displacement is weighted by the confidence of both estimates and by the mass
of the belief on the map. A camera that passes five images of the map between two of its own is thus followed as well as
one that passes one, and the pace survives uninformative images. The estimates of a lost filter scatter: there is no
pace as long as the interquartile range of displacements exceeds four spacings of the map plus the pace itself. This is
the constant-velocity model, with a velocity per step estimated from displacements.

The constants were chosen on walks of Gardens Point, the railway of Nordland, a tower and towns:
results/localization_change.md, "Without odometry".
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_between

#: total weight of the last displacements that are kept; one from a fully confident filter has weight 1
REMEMBERED = 10.0
#: largest number of displacements
MOST = 100
#: the largest interquartile range of displacements that agree, in spacings of the map, beyond the pace itself
AGREE = 4.0
#: number of displacements needed for a pace
ENOUGH = 5


@dataclass(frozen=True)
class ConstantVelocity:
    """The displacement from one step to the next.

    Attributes:
        ways: the last displacements, in the unit of the map, with their weights.

    Example:
        >>> import torch
        >>> pace, here = ConstantVelocity(), torch.zeros(3, dtype=torch.float64)
        >>> for way in (2.0, 2.1, -40.0, 1.9, 2.0):
        ...     pace = pace.updated(here, torch.tensor([way, 0.0, 0.0], dtype=torch.float64), 1.0)
        >>> pace.along(spacing=1.0)
        2.0
    """

    ways: tuple[tuple[float, float], ...] = ()

    def along(self, spacing: float) -> float | None:
        """The weighted median of the displacements; None while they are too few, or where they disagree.

        Args:
            spacing: spacing of the map.
        """
        if len(self.ways) < ENOUGH:
            return None
        ways, weights = np.array(self.ways).T
        first, middle, last = np.quantile(ways, [0.25, 0.5, 0.75], weights=weights, method="inverted_cdf")
        return float(middle) if last - first <= AGREE * spacing + abs(middle) else None

    def updated(self, before: Float64[Tensor, "3"], after: Float64[Tensor, "3"], weight: float, steps: int = 1) -> Self:
        """The pace with the displacement between two estimated poses added.

        Args:
            before, after: the poses.
            weight: confidence in them, in [0, 1].
            steps: number of steps from one to the other.
        """
        way = float(se2_between(before, after)[0]) / steps
        if not (math.isfinite(way) and weight > 0):
            return self
        ways, total = [(way, weight)], weight
        for one in reversed(self.ways):
            if total >= REMEMBERED or len(ways) == MOST:
                break
            ways.append(one)
            total += one[1]
        return type(self)(tuple(reversed(ways)))
