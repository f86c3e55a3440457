r"""Whether images match the places predicted by the belief before they were taken.

A confident filter may follow wrong odometry, or images of another world: some place of the map is always the most
similar. Correct predictions, however, do not come by chance. Let F_i be the share of the map's images that are less
similar to an image than image i is, and i(x) the map image nearest to a pose. The *foresight* of the belief for the
image is then

.. math:: f_t = \sum_k W_{t-1}^k \, F_{i(x_{t-1}^k \circ u_t)} :

1 if no other image is more similar, and 1/2 on average, whatever the descriptor, if the belief is unrelated to the
observation. A running mean of f over about n images indicates whether the filter is lost. Each image is weighted by its
novelty and by the mass of the belief on the map. Without odometry nothing can be predicted.

This is the innovation test of Kalman filters (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to
Tracking and Navigation", 2001, section 5.4) in terms of ranks, which do not require a calibrated likelihood. The
constants were chosen on Gardens Point and the railway of Nordland (results/localization_change.md, "When it is lost").
"""

import math
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

#: n: after this many images, a new one contributes one part in n to the mean
REMEMBERED = 20.0
#: number of images needed for a verdict
FEWEST = 5.0
#: a belief with less mean foresight than this is lost
LEAST = 0.65
#: number of map images that an image is compared with, and of poses drawn from the belief, both evenly chosen
LOOKED_AT, ASKED = 4096, 128


@dataclass(frozen=True)
class InnovationTest:
    r"""How well the belief predicted recent images.

    Attributes:
        mean: running mean of f.
        images: sum of the images' weights, at most n.

    Example:
        >>> foresight, over_map = InnovationTest(), torch.arange(10.0).double()  # each image is most like the tenth
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
        """Whether the belief failed to predict the recent images."""
        return self.told < LEAST


def foreseen(over_map: Float64[Tensor, " n"], expected: Int64[Tensor, " k"]) -> float:
    """The foresight f of one image.

    Args:
        over_map: log-likelihoods of the image at the images of the map.
        expected: rows of the map images nearest to poses of the belief, which have equal weight.

    Returns:
        The mean share of the other map images that are less similar to the image; ties count half. nan if there is no
        other image.

    Example:
        >>> over_map = torch.tensor([0.0, -1.0, -2.0, -3.0, -4.0], dtype=torch.float64)
        >>> foreseen(over_map, torch.tensor([0, 1]))  # the most similar one, and the next
        0.875
    """
    some = over_map[:: -(-len(over_map) // LOOKED_AT)]
    some = some[some.isfinite()].sort().values
    if len(some) < 2:
        return math.nan
    told = over_map[expected].nan_to_num(-torch.inf)
    below = torch.searchsorted(some, told) + torch.searchsorted(some, told, right=True) - 1  # ties count half
    return float((below / (2 * (len(some) - 1))).clamp(0, 1).mean())


def drawn_evenly(weights: Float64[Tensor, " p"]) -> Int64[Tensor, " k"]:
    """Rows of equally weighted particles, chosen deterministically at the middles of 128 equal parts of the weight.

    Example:
        >>> drawn_evenly(torch.tensor([0.5, 0.0, 0.25, 0.25])).bincount()
        tensor([64,  0, 32, 32])
    """
    middles = (torch.arange(ASKED, dtype=weights.dtype, device=weights.device) + 0.5) / ASKED
    return torch.searchsorted(weights.cumsum(0), middles * weights.sum()).clamp(max=len(weights) - 1)
