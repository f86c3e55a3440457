"""Multinomial resampling: independent draws."""

from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.localization.resampling.resampling import Resampling, at_quantiles


@dataclass(frozen=True)
class MultinomialResampling(Resampling):
    """Draws each ancestor independently, as in the bootstrap filter of Gordon, Salmond & Smith (IEE-F 1993).

    Example:
        >>> log_weights = torch.tensor([[0.5, 0.25, 0.25]]).double().log()
        >>> MultinomialResampling().resample(log_weights, 4, torch.Generator().manual_seed(0))  # not in proportion
        tensor([[2, 1, 0, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw with replacement."""
        uniform = torch.rand(len(weights), width, generator=generator, dtype=weights.dtype, device=weights.device)
        return at_quantiles(weights, uniform)
