"""Systematic resampling: one random offset and equal steps."""

from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.localization.resampling.resampling import Resampling, at_quantiles


@dataclass(frozen=True)
class SystematicResampling(Resampling):
    r"""Draws particles at the quantiles :math:`(k + u)/n`, with one number :math:`u \sim U[0, 1)` for each run.

    Each particle is drawn :math:`\lfloor n W_i \rfloor` or :math:`\lceil n W_i \rceil` times. In practice this has the
    least variance, though the number of copies of a particle depends on the order of the others.

    Example:
        >>> log_weights = torch.tensor([[0.6, 0.3, 0.1]]).double().log()
        >>> SystematicResampling().resample(log_weights, 10, torch.Generator().manual_seed(0))  # 6, 3 and 1
        tensor([[0, 0, 0, 0, 0, 0, 1, 1, 1, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw at equal steps from a random offset."""
        offset = torch.rand(len(weights), 1, generator=generator, dtype=weights.dtype, device=weights.device)
        return at_quantiles(weights, (torch.arange(width, device=weights.device) + offset) / counts)
