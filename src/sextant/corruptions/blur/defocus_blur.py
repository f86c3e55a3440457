r"""Defocus blur: a lens out of focus.

.. math:: y = k * x, \qquad k = G_a * D_r, \qquad D_r(u, v) \propto [u^2 + v^2 \le r^2]

a disk of r pixels softened by a Gaussian of a pixels, with the image mirrored at the centres of its edge pixels.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.filtering.border import inside
from sextant.corruptions.filtering.gaussian_filter import gaussian_weights
from sextant.corruptions.filtering.shifted_sum import shifted_sum


@lru_cache(maxsize=32)
def disk_kernel(radius: float, alias: float) -> Float[Tensor, "k k"]:
    """The softened disk ``(k, k)``, without the rows and columns that are zero; float64; cached, so do not change it.

    As in the authors' code, a disk of up to 8 pixels lies on a grid of 17 x 17 pixels and is softened by 3 x 3 weights,
    a larger one by 5 x 5 on a grid that just holds it, with the grid mirrored at its edge.
    """
    reach, soft = (8, 1) if radius <= 8 else (math.floor(radius), 2)
    grid = torch.arange(-reach, reach + 1)
    disk = (grid[:, None] ** 2 + grid**2 <= radius**2).double()
    disk /= disk.sum()
    weights = gaussian_weights(alias, soft)
    taps = torch.arange(-soft, soft + 1)
    for _ in range(2):  # down, then across
        disk = sum(
            w * disk[inside(torch.arange(2 * reach + 1) + t, 2 * reach + 1, "mirror")]
            for w, t in zip(weights, taps.tolist(), strict=True)
        ).T
    used = int(torch.nonzero(disk.sum(0)).min())
    return disk[used : 2 * reach + 1 - used, used : 2 * reach + 1 - used].contiguous()


@dataclass(frozen=True)
class DefocusBlur(BenchmarkCorruption[tuple[float, float], None]):
    """Convolution with a softened disk.

    The disk of 8 pixels on a grid of 17 and the disk of 10 on a grid of 21 touch the edge of their grid, where the
    mirroring counts weights twice: the published kernels of ImageNet-C sum to 1.013 and 1.011 at severities 4 and 5,
    and brighten the image. ``faithful`` keeps that; ``corrected`` scales every kernel to the sum 1.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> spot = torch.zeros(1, 1, 9, 9)
    >>> spot[..., 4, 4] = 1
    >>> DefocusBlur(((2.0, 0.1),), "defocus_blur")(spot, level=1, indices=[0], seed=0)[0, 0, 4, 1:8].round(decimals=3)
    tensor([0.0000, 0.0770, 0.0770, 0.0770, 0.0770, 0.0770, 0.0000])

    Args:
        table: (radius, softening) in pixels for each severity.
        name: the corruption's name.
        levels: the severities to test at.
        mode: whether kernels keep their published sums.
    """

    mode: Mode = "faithful"

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Convolve every channel with the disk."""
        kernel = disk_kernel(*self.row(level))
        if self.mode == "corrected":
            kernel = kernel / kernel.sum()
        row, column = torch.nonzero(kernel, as_tuple=True)
        shifts = torch.stack([column, row], -1) - len(kernel) // 2
        return shifted_sum(images, kernel[row, column], shifts[None], "mirror").clamp(0, 1)
