r"""Magnification of an image's centre, cropped to the image's size, as in the benchmark authors' code.

The central :math:`c = \lceil n/z \rceil` pixels of an axis of n are magnified to :math:`m = \mathrm{round}(c z)` by
linear interpolation that maps the first pixel onto the first and the last onto the last
(:func:`scipy.ndimage.zoom` of order 1), and the central n of these are kept. An axis is one matrix ``(n, n)``.

Source: Hendrycks & Dietterich, ICLR 2019; ``clipped_zoom`` in hendrycks/robustness. There the image is square.
"""

import math
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor


@lru_cache(maxsize=512)
def zoom_matrix(size: int, factor: float) -> Tensor:
    """The zoom by ``factor`` ≥ 1 along an axis of ``size`` pixels ``(size, size)``; float64, not to be changed."""
    kept = math.ceil(size / factor)
    magnified = round(kept * factor)
    first = (size - kept) // 2
    rows = torch.arange(size)
    step = (kept - 1) / (magnified - 1) if magnified > 1 else 0.0
    source = (rows + (magnified - size) // 2).double() * step
    left = source.floor().long().clamp(0, max(kept - 2, 0))
    weight = source - left
    matrix = torch.zeros(size, size, dtype=torch.float64)
    matrix[rows, first + left] += 1 - weight
    matrix[rows, first + (left + 1).clamp(max=kept - 1)] += weight
    return matrix


def clipped_zoom(images: Float[Tensor, "b c h w"], factor: float) -> Float[Tensor, "b c h w"]:
    """The centre of ``images`` magnified by ``factor`` ≥ 1, of the same size.

    Example:
        >>> image = torch.tensor([9.0, 1.0, 4.0, 9.0]).expand(1, 1, 4, 4)
        >>> clipped_zoom(image, 2.0)[0, 0, 0].round(decimals=4)  # the middle two pixels, stretched over four
        tensor([1., 2., 3., 4.])
    """
    height, width = images.shape[-2:]
    return zoom_matrix(height, factor).to(images) @ images @ zoom_matrix(width, factor).to(images).T
