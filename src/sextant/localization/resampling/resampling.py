r"""The interface of resampling schemes, which choose the particles that the next ones descend from.

All are unbiased: of n draws, an expected :math:`n W_i` are of particle i. They differ in the variance of that number.
Source: Douc, Cappé & Moulines, "Comparison of Resampling Schemes for Particle Filtering", ISPA 2005.
"""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float64, Int64
from torch import Tensor


class Resampling(ABC):
    """Draws ancestors in all runs at once."""

    def resample(
        self,
        log_weights: Float64[Tensor, "r p"],
        count: int | Int64[Tensor, "r"],
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Indices of the ancestors.

        Args:
            log_weights: need not be normalised.
            count: number of particles to draw, one for all runs or one for each. In the second case the result is as
                wide as the largest count, and indices beyond a run's own count are meaningless.
            generator: generator of random numbers.

        Raises:
            ValueError: a run has no weight above zero or one that is nan or infinite, or a count is below 1.
        """
        best = log_weights.amax(1, keepdim=True)
        if not bool(best.isfinite().all()):
            raise ValueError("a run has no weight above zero, or one that is nan or infinite")
        counts = torch.as_tensor(count, device=log_weights.device).expand(len(log_weights))[:, None]
        if bool((counts < 1).any()):
            raise ValueError("at least one particle must be drawn in each run")
        weights = (log_weights - best).exp()
        return self.ancestors(weights / weights.sum(1, keepdim=True), counts, int(counts.max()), generator)

    @abstractmethod
    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw the indices, given weights that sum to one."""


def at_quantiles(weights: Float64[Tensor, "r p"], quantiles: Float64[Tensor, "r c"]) -> Int64[Tensor, "r c"]:
    """The particle at each quantile in [0, 1) of the weight distribution; never one of weight zero.

    Quantiles of 1 and above give the last particle with a weight.
    """
    cumulative = weights.cumsum(1)
    total = cumulative[:, -1:].contiguous()
    last = torch.searchsorted(cumulative, total)  # the first to reach the total: all after it have no weight
    return torch.searchsorted(cumulative, quantiles * total, right=True).minimum(last)
