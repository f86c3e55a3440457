r"""Motion blur along a line, with ImageMagick's kernel.

.. math:: y(p) = \sum_{i=0}^{W-1} k_i\, x\bigl(p + \lceil i (\cos θ, \sin θ) - \tfrac12 \rceil\bigr),
    \qquad k_i \propto e^{-i^2 / 2σ^2}, \qquad W = 2\lceil r \rceil + 1

in (column, row) with rows downward: a one-sided Gaussian, sampled at the nearest pixel, with the edge pixels repeated
beyond the edge. r and σ are in pixels. Source: ``MotionBlurImage`` of ImageMagick 6 and 7, which the authors of the
benchmarks call; ImageMagick itself is not needed.
"""

import math

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.filtering.shifted_sum import shifted_sum


def motion_weights(radius: float, sigma: float) -> Float[Tensor, "w"]:
    """The weights along the line, from the pixel itself outward; sum 1; float64.

    Example:
        >>> motion_weights(1.0, 1.0).round(decimals=4)  # in proportion to 1, exp(-1/2) and exp(-2)
        tensor([0.5741, 0.3482, 0.0777], dtype=torch.float64)
    """
    steps = torch.arange(2 * math.ceil(radius) + 1, dtype=torch.float64)
    weights = torch.exp(-(steps**2) / (2 * sigma**2))
    return weights / weights.sum()


def motion_offsets(degrees: Float[Tensor, "b"], count: int) -> Int64[Tensor, "b n 2"]:
    """(column, row) of the ``count`` pixels along each line.

    Example:
        >>> motion_offsets(torch.tensor([0.0, 90.0]), 3).tolist()  # to the right, and down
        [[[0, 0], [1, 0], [2, 0]], [[0, 0], [0, 1], [0, 2]]]
    """
    angle = torch.deg2rad(degrees.double().cpu())
    line = torch.stack([angle.cos(), angle.sin()], -1)
    steps = torch.arange(count, dtype=torch.float64)
    return torch.ceil(steps[None, :, None] * line[:, None] - 0.5).long()


def motion_blur(
    images: Float[Tensor, "b c h w"], radius: float, sigma: float, degrees: Float[Tensor, "b"]
) -> Float[Tensor, "b c h w"]:
    """Blur each of ``images`` along its own angle (degrees, clockwise from the right as rows point down).

    Example:
        >>> spot = torch.tensor([0.0, 0.0, 0.0, 1.0, 0.0]).view(1, 1, 1, 5)
        >>> blurred = motion_blur(spot, radius=1.0, sigma=1.0, degrees=torch.tensor([0.0]))
        >>> blurred.flatten().round(decimals=2)  # a pixel takes from those to its right
        tensor([0.0000, 0.0800, 0.3500, 0.5700, 0.0000])
    """
    weights = motion_weights(radius, sigma)
    return shifted_sum(images, weights, motion_offsets(degrees, len(weights)), "nearest")
