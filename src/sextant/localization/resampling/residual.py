"""Residual resampling: whole copies first, then draws for the remainder."""

from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.localization.resampling.resampling import Resampling, at_quantiles


@dataclass(frozen=True)
class ResidualResampling(Resampling):
    r"""Makes :math:`\lfloor n W_i \rfloor` copies of each particle and draws the others by the rest of :math:`n W_i`.

    Source: Liu & Chen, "Sequential Monte Carlo Methods for Dynamic Systems", JASA 1998.

    Example:
        >>> log_weights = torch.tensor([[0.5, 0.25, 0.25]]).double().log()
        >>> ResidualResampling().resample(log_weights, 4, torch.Generator())  # n W is whole: nothing is left to chance
        tensor([[0, 0, 1, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Copy in the order of the particles, then draw."""
        expected = weights * counts
        copies = expected.floor()
        slots = torch.arange(width, dtype=torch.int64, device=weights.device).expand(len(weights), -1).contiguous()
        taken = copies.long().cumsum(1)
        copied = torch.searchsorted(taken, slots, right=True).clamp(max=weights.shape[1] - 1)
        left = expected - copies
        left = torch.where(left.sum(1, keepdim=True) > 0, left, weights)  # if nothing is left, no draw will be used
        uniform = torch.rand(len(weights), width, generator=generator, dtype=weights.dtype, device=weights.device)
        return torch.where(slots < taken[:, -1:], copied, at_quantiles(left, uniform))
