r"""Gaussian smoothing of a batch, equal to :func:`scipy.ndimage.gaussian_filter` over height and width.

Each axis is one matrix, :math:`Y = G_h X G_w^T`, with :math:`G_{ij} = \sum_{k:\, b(i+k)=j} g_k`, where b folds what
lies beyond the edge back into the image and :math:`g_k \propto e^{-k^2 / 2σ^2}` for
:math:`|k| \le \lfloor tσ + 1/2 \rfloor`.
For small images this is faster than convolution, and any border is exact.
"""

from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.corruptions.filtering.border import Border, inside


def gaussian_weights(sigma: float, radius: int) -> Float[Tensor, "n"]:
    """``exp(-k²/2σ²)`` for k = -radius ... radius, scaled to the sum 1; float64.

    Example:
        >>> gaussian_weights(1.0, 1).round(decimals=4)  # in proportion to exp(-1/2), 1 and exp(-1/2)
        tensor([0.2741, 0.4519, 0.2741], dtype=torch.float64)
        >>> gaussian_weights(0.0, 1)  # changes nothing
        tensor([1.], dtype=torch.float64)
    """
    if sigma <= 0 or radius == 0:
        return torch.ones(1, dtype=torch.float64)
    weights = torch.exp(-0.5 * (torch.arange(-radius, radius + 1, dtype=torch.float64) / sigma) ** 2)
    return weights / weights.sum()


@lru_cache(maxsize=128)
def gaussian_matrix(size: int, sigma: float, border: Border = "nearest", truncate: float = 4.0) -> Tensor:
    """Smoothing along an axis of ``size`` pixels as a matrix ``(size, size)``; float64, not to be changed."""
    weights = gaussian_weights(sigma, int(truncate * sigma + 0.5))
    reach = len(weights) // 2
    rows = torch.arange(size)[:, None].expand(size, len(weights))
    columns = inside(rows + torch.arange(-reach, reach + 1), size, border)
    return torch.zeros(size, size, dtype=torch.float64).index_put_((rows, columns), weights.expand_as(rows), True)


def gaussian_filter(
    images: Float[Tensor, "b c h w"],
    sigma: float | tuple[float, float],
    border: Border = "nearest",
    truncate: float = 4.0,
) -> Float[Tensor, "b c h w"]:
    """``images`` smoothed by ``sigma`` pixels, or by (down, across); an axis with ``sigma = 0`` is left alone.

    Example:
        >>> spot = torch.zeros(1, 1, 5, 5)
        >>> spot[..., 2, 2] = 1
        >>> gaussian_filter(spot, (0.5, 0.0))[0, 0].round(decimals=2)  # down alone
        tensor([[0.0000, 0.0000, 0.0000, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.1100, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.7900, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.1100, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.0000, 0.0000, 0.0000]])
    """
    down, across = sigma if isinstance(sigma, tuple) else (sigma, sigma)
    if down > 0:
        images = gaussian_matrix(images.shape[-2], down, border, truncate).to(images) @ images
    if across > 0:
        images = images @ gaussian_matrix(images.shape[-1], across, border, truncate).to(images).T
    return images
