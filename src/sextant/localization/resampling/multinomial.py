"""Independent draws."""

from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.localization.resampling.resampling import Resampling, at_quantiles


@dataclass(frozen=True)
class MultinomialResampling(Resampling):
    """Each ancestor is drawn by itself: the bootstrap filter of Gordon, Salmond & Smith (IEE-F 1993)."""

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draws with replacement."""
        uniform = torch.rand(len(weights), width, generator=generator, dtype=weights.dtype, device=weights.device)
        return at_quantiles(weights, uniform)
