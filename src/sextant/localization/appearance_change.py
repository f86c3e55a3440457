r"""The change of appearance since the map was made, estimated while driving.

What has changed everywhere, such as the light or the season, shifts the mean descriptor of a drive away from that of
the map. This shift is removed gradually:

.. math:: z'_t = z_t - \frac{n_t}{n_t + n_0}\,(\bar z_t - \bar y), \qquad
   \bar z_t = \frac1{n_t} \sum_{s \le t} w_s z_s, \quad n_t = \sum_{s \le t} w_s.

What remains is an appearance variance, the same in every dimension. If nothing had changed, the map image that explains
a descriptor best would do so within the predicted variance v. The minimum over many images is biased low, so the excess
counts one and a half times:

.. math:: s_a^2 = \frac{1.5}{n_t} \sum_{s \le t} w_s \max\!\Big(0,\; \min_i \frac{\|z'_s - \mu_i\|^2}{D} - v_i\Big).

The weight w of an image is how far the robot has moved since the last one, in units of the map's spacing and of the
turn that the map resolves, and at most 1. While a robot stands still, the estimates do not change.
"""

from dataclasses import dataclass, replace
from typing import Self

import torch
from jaxtyping import Float32, Float64
from torch import Tensor

from sextant.localization.constants import EXCESS, FEW
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.model import Residuals


@dataclass(frozen=True)
class AppearanceChange:
    """The change of appearance estimated from the drives of r runs so far.

    Attributes:
        mean: :math:`\\bar z`, the weighted mean descriptor.
        excess: mean of what exceeds the predicted variance.
        images: n, the sum of the images' weights.

    Example:
        >>> change, bright = AppearanceChange.none(1, 2), torch.tensor([[6.0, 0.0]])
        >>> for _ in range(5):  # a drive that is brighter everywhere than the map, whose mean is 0
        ...     change = change.updated(bright, weight=torch.ones(1).double())
        >>> change.centred(bright, map_mean=torch.zeros(2))  # after five images half of the change is removed
        tensor([[3., 0.]])
    """

    mean: Float64[Tensor, "r d"]
    excess: Float64[Tensor, " r"]
    images: Float64[Tensor, " r"]

    @classmethod
    def none(cls, runs: int, dimension: int, device: torch.device | None = None) -> Self:
        """The state before the first image."""
        nothing = torch.zeros(runs, dimension + 2, dtype=torch.float64, device=device)
        return cls(nothing[:, 2:], nothing[:, 0], nothing[:, 1])

    def updated(self, descriptors: Float32[Tensor, "r d"], weight: Float64[Tensor, " r"]) -> Self:
        """The state after one more image of each run."""
        images = self.images + weight
        step = torch.where(images > 0, weight / images, 0.0)[:, None]
        return replace(self, mean=self.mean + step * (descriptors.double() - self.mean), images=images)

    def exceeded(self, residuals: Residuals, dimension: int, weight: Float64[Tensor, " r"]) -> Self:
        """The state with the excess of that image added, given its residuals to the map."""
        least = (residuals.squared / dimension - residuals.variance).amin(1)
        step = torch.where(self.images > 0, weight / self.images, 0.0)
        return replace(self, excess=self.excess + step * (least.clamp(min=0.0) - self.excess))

    def centred(self, descriptors: Float32[Tensor, "r d"], map_mean: Float32[Tensor, " d"]) -> Float32[Tensor, "r d"]:
        """z', descriptors with the change common to all images of their run removed."""
        learned = (self.images / (self.images + FEW))[:, None]
        return descriptors - (learned * (self.mean - map_mean)).to(descriptors.dtype)

    def likelihood(self, calibrated: Likelihood) -> Likelihood:
        """The calibrated likelihood with the appearance variance that each run has learned so far added to its own."""
        return replace(calibrated, appearance_variance=calibrated.appearance_variance + EXCESS * self.excess[:, None])
