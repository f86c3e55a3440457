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

from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

from sextant.localization.constants import FEW, FORESEEN, RECENT

#: number of map images that an image is compared with, and of poses drawn from the belief, both evenly chosen
LOOKED_AT, ASKED = 4096, 128


@dataclass(frozen=True)
class InnovationTest:
    r"""How well the beliefs of r runs predicted recent images.

    Attributes:
        mean: running mean of f.
        images: sum of the images' weights, at most n.

    Example:
        >>> foresight, over_map = InnovationTest.none(1), torch.arange(10.0).double()[None]  # most like the tenth place
        >>> for _ in range(5):
        ...     found = foreseen(over_map, torch.tensor([[2]]))  # the third was expected
        ...     foresight = foresight.updated(found, torch.ones(1).double())
        >>> foresight.told.round(decimals=2).tolist(), foresight.failed.tolist()
        ([0.22], [True])
    """

    mean: Float64[Tensor, " r"]
    images: Float64[Tensor, " r"]

    @classmethod
    def none(cls, runs: int, images: float = 0.0, device: torch.device | None = None) -> Self:
        """The state before the first image, or after a weight of ``images`` at chance."""
        chance = torch.full((runs,), 0.5, dtype=torch.float64, device=device)
        return cls(chance, torch.full_like(chance, images))

    def updated(self, foreseen: Float64[Tensor, " r"], weight: Float64[Tensor, " r"]) -> Self:
        """The state after one more image of each run; a value that is not a number is ignored."""
        images = (self.images + weight).clamp(max=RECENT)
        mean = self.mean + (weight / images).clamp(max=1.0) * (foreseen - self.mean)
        counts = (weight > 0) & foreseen.isfinite()
        return type(self)(torch.where(counts, mean, self.mean), torch.where(counts, images, self.images))

    @property
    def told(self) -> Float64[Tensor, " r"]:
        """The running mean; nan before the fifth image."""
        return torch.where(self.images >= FEW, self.mean, torch.nan)

    @property
    def failed(self) -> Bool[Tensor, " r"]:
        """Whether the belief failed to predict the recent images."""
        return self.told < FORESEEN


def foreseen(over_map: Float64[Tensor, "r n"], expected: Int64[Tensor, "r k"]) -> Float64[Tensor, " r"]:
    """The foresight f of one image of each run.

    Args:
        over_map: log-likelihoods of the image at the images of the map.
        expected: rows of the map images nearest to poses of the belief, which have equal weight.

    Returns:
        The mean share of the other map images that are less similar to the image; ties count half. nan if there is no
        other image.

    Example:
        >>> over_map = torch.tensor([[0.0, -1.0, -2.0, -3.0, -4.0]], dtype=torch.float64)
        >>> float(foreseen(over_map, torch.tensor([[0, 1]])))  # the most similar one, and the next
        0.875
    """
    some = over_map[:, :: -(-over_map.shape[1] // LOOKED_AT)]
    some = some.where(some.isfinite(), torch.inf).sort(1).values  # what is not finite comes last
    others = some.isfinite().sum(1) - 1
    told = over_map.gather(1, expected).nan_to_num(-torch.inf)
    below = torch.searchsorted(some, told) + torch.searchsorted(some, told, right=True) - 1  # ties count half
    return torch.where(others > 0, (below / (2 * others[:, None])).clamp(0, 1).mean(1).double(), torch.nan)


def drawn_evenly(weights: Float64[Tensor, "r p"]) -> Int64[Tensor, "r k"]:
    """Rows of equally weighted particles, chosen deterministically at the middles of 128 equal parts of the weight.

    Example:
        >>> drawn_evenly(torch.tensor([[0.5, 0.0, 0.25, 0.25]]))[0].bincount()
        tensor([64,  0, 32, 32])
    """
    middles = (torch.arange(ASKED, dtype=weights.dtype, device=weights.device) + 0.5) / ASKED
    parts = middles * weights.sum(1, keepdim=True)
    return torch.searchsorted(weights.cumsum(1), parts).clamp(max=weights.shape[1] - 1)
