r"""Whether images look like the places where the robot was believed to be before they were taken.

A filter that is sure of itself may follow wrong odometry, or images of another world: some place of the map always
looks most alike. To be foreseen, however, does not come by chance. Let F_i be the share of the map's images that an
image resembles less than it resembles image i, and i(x) the map image nearest to a pose. The belief then foresaw the
image by

.. math:: f_t = \sum_k W_{t-1}^k \, F_{i(x_{t-1}^k \circ u_t)} :

1 if nothing else looks more alike, and 1/2 on average, whatever the descriptor, if the belief has nothing to do with
what is seen. A running mean of f that remembers about n images says whether the filter knows where it is. Each image is
weighted by how new it is and by how much of the belief is on the map. Without odometry nothing can be foreseen.

This is the innovation test of Kalman filters (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to
Tracking and Navigation", 2001, section 5.4) in terms of ranks, which do not need a likelihood that is right in absolute
terms. The constants were chosen on Gardens Point and the railway of Nordland (docs/localization_change.md, "When it is
lost").
"""

import math
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

#: n: once this many images have been seen, a new one contributes one part in n to the mean
REMEMBERED = 20.0
#: number of images needed for a verdict
FEWEST = 5.0
#: a belief that foresaw less than this is lost
LEAST = 0.65
#: number of map images that an image is compared with, and of poses drawn from the belief, both evenly chosen
LOOKED_AT, ASKED = 4096, 128


@dataclass(frozen=True)
class InnovationTest:
    r"""How well recent images were foreseen.

    Attributes:
        mean: running mean of f.
        images: sum of the images' weights, at most n.

    Example:
        >>> foresight, over_map = InnovationTest(), torch.arange(10.0).double()  # each image looks most like the tenth
        >>> for _ in range(5):
        ...     foresight = foresight.updated(foreseen(over_map, torch.tensor([2])), 1.0)  # the third was expected
        >>> round(foresight.told, 2), foresight.failed
        (0.22, True)
    """

    mean: float = 0.5
    images: float = 0.0

    def updated(self, foreseen: float, weight: float) -> Self:
        """The state after one more image; a value that is not a number is ignored."""
        if weight <= 0 or not math.isfinite(foreseen):
            return self
        images = min(self.images + weight, REMEMBERED)
        return type(self)(self.mean + min(1.0, weight / images) * (foreseen - self.mean), images)

    @property
    def told(self) -> float:
        """The running mean; nan before the fifth image."""
        return self.mean if self.images >= FEWEST else math.nan

    @property
    def failed(self) -> bool:
        """Whether the belief failed to foresee what was seen."""
        return self.told < LEAST


def foreseen(over_map: Float64[Tensor, " n"], expected: Int64[Tensor, " k"]) -> float:
    """The foresight f of one image.

    Args:
        over_map: log-likelihoods of the image at the images of the map.
        expected: rows of the map images nearest to poses of the belief, which have equal weight.

    Returns:
        The mean share of the other map images that the image resembles less; ties count half. nan if there is no other
        image.

    Example:
        >>> over_map = torch.tensor([0.0, -1.0, -2.0, -3.0, -4.0], dtype=torch.float64)
        >>> foreseen(over_map, torch.tensor([0, 1]))  # the one that looks most alike, and the next
        0.875
    """
    some = over_map[:: -(-len(over_map) // LOOKED_AT)]
    some = some[some.isfinite()].sort().values
    if len(some) < 2:
        return math.nan
    told = over_map[expected].nan_to_num(-torch.inf)
    below = torch.searchsorted(some, told) + torch.searchsorted(some, told, right=True) - 1  # twice, itself half
    return float((below / (2 * (len(some) - 1))).clamp(0, 1).mean())


def drawn_evenly(weights: Float64[Tensor, " p"]) -> Int64[Tensor, " k"]:
    """Rows of equally weighted particles, chosen without chance at the middles of 128 equal parts of the weight.

    Example:
        >>> drawn_evenly(torch.tensor([0.5, 0.0, 0.25, 0.25])).bincount()
        tensor([64,  0, 32, 32])
    """
    middles = (torch.arange(ASKED, dtype=weights.dtype, device=weights.device) + 0.5) / ASKED
    return torch.searchsorted(weights.cumsum(0), middles * weights.sum()).clamp(max=len(weights) - 1)
