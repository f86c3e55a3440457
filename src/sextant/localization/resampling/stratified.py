"""Stratified resampling: one random number in each of n equal strata."""

from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.localization.resampling.resampling import Resampling, at_quantiles


@dataclass(frozen=True)
class StratifiedResampling(Resampling):
    r"""Draws particles at the quantiles :math:`(k + u_k)/n`, :math:`u_k \sim U[0, 1)`.

    The variance is never larger than that of independent draws.

    Example:
        >>> log_weights = torch.tensor([[0.5, 0.25, 0.25]]).double().log()
        >>> StratifiedResampling().resample(log_weights, 4, torch.Generator())  # one in each quarter of the weight
        tensor([[0, 0, 1, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw once within each stratum."""
        offsets = torch.rand(len(weights), width, generator=generator, dtype=weights.dtype, device=weights.device)
        return at_quantiles(weights, (torch.arange(width, device=weights.device) + offsets) / counts)
