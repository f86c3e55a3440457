r"""Zoom blur: a camera that zooms during the exposure.

.. math:: y = \frac{1}{n + 1} \Bigl(x + \sum_{i=1}^{n} Z_{z_i} x\Bigr), \qquad z_i = 1, 1 + δ, \ldots < z_{end}

with :math:`Z_z x = A_z x B_z^T` the clipped zoom. All zooms together take two matrix products, one for each side.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.filtering.clipped_zoom import zoom_matrix

CHUNK = 2**18  # zoomed values at a time, so that they stay in the processor's cache


@lru_cache(maxsize=32)
def zoom_factors(end: float, step: float) -> tuple[float, ...]:
    """1, 1 + step, ... below ``end``, with the rounding of ``numpy.arange``, which decides whether the last is in."""
    return tuple(np.arange(1, end, step).tolist())


@lru_cache(maxsize=64)
def _stacked(size: int, factors: tuple[float, ...]) -> Tensor:
    return torch.stack([zoom_matrix(size, factor) for factor in factors])


@dataclass(frozen=True)
class ZoomBlur(BenchmarkCorruption[tuple[float, float], None]):
    """The mean of the image and its magnifications.

    Source: Hendrycks & Dietterich, ICLR 2019. The image counts twice, once as the zoom by 1.

    >>> image = torch.zeros(1, 1, 9, 9)
    >>> image[..., 0, :] = 1  # a line on the border, which a zoom by 2 leaves out
    >>> ZoomBlur(((2.5, 1.0),), "zoom_blur")(image, level=1, indices=[0], seed=0)[0, 0, 0, 4]  # (1 + 1 + 0) / 3
    tensor(0.6667)

    Args:
        table: (end of the zooms, their step) for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Average over the zooms."""
        height, width = images.shape[-2:]
        factors = zoom_factors(*self.row(level))
        down = _stacked(height, factors).to(images).transpose(0, 1).flatten(0, 1)  # (h n, h)
        across = _stacked(width, factors).to(images).transpose(1, 2).flatten(0, 1)  # (n w, w)
        planes = images.flatten(0, 1)
        total = torch.empty_like(planes)
        step = max(CHUNK // (len(factors) * height * width), 1)
        for first in range(0, len(planes), step):
            zoomed = down @ planes[first : first + step]  # (step, h n, w)
            total[first : first + step] = zoomed.view(-1, height, len(factors) * width) @ across
        return total.view_as(images).add_(images).div_(len(factors) + 1).clamp_(0, 1)
