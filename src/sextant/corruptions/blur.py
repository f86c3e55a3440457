"""Blur: out of focus, in motion, behind glass."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.compiled import compiled
from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.contract import Images, Positions
from sextant.corruptions.filtering import (
    gaussian_filter,
    gaussian_weights,
    inside,
    motion_blur,
    shifted_sum,
    zoom_matrix,
)
from sextant.corruptions.pixels import eight_bit, to_bytes


@dataclass(frozen=True)
class GaussianBlur(BenchmarkCorruption[float, None]):
    """``y = G_σ * x``, cut at 4σ, with the edge pixels repeated beyond the edge.

    Source: Hendrycks & Dietterich, ICLR 2019 (an extra corruption, for validation), with ``skimage.filters.gaussian``.

    >>> import torch
    >>> line = torch.tensor([0.0, 0.0, 1.0, 0.0, 0.0]).view(1, 1, 1, 5)
    >>> GaussianBlur((0.5,), "gaussian_blur")(line, level=1, indices=[0], seed=0).round(decimals=3)
    tensor([[[[0.0000, 0.1060, 0.7870, 0.1060, 0.0000]]]])

    Args:
        table: σ in pixels for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Smooth over height and width."""
        return gaussian_filter(images, self.row(level)).clamp(0, 1)


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
    r"""Convolution with a softened disk.

    .. math:: y = k * x, \qquad k = G_a * D_r, \qquad D_r(u, v) \propto [u^2 + v^2 \le r^2]

    a disk of r pixels softened by a Gaussian of a pixels, with the image mirrored at the centres of its edge pixels.

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

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Convolve every channel with the disk."""
        kernel = disk_kernel(*self.row(level))
        if self.mode == "corrected":
            kernel = kernel / kernel.sum()
        row, column = torch.nonzero(kernel, as_tuple=True)
        shifts = torch.stack([column, row], -1) - len(kernel) // 2
        return shifted_sum(images, kernel[row, column], shifts[None], "mirror").clamp(0, 1)


@dataclass(frozen=True)
class GlassBlur(BenchmarkCorruption[tuple[float, int, int], Tensor]):
    """Gaussian blur, local shuffling of pixels, Gaussian blur.

    Scanning from the last row and column, every pixel p is swapped with p + d, with d drawn from {-m, ..., m - 1}² for
    a largest distance m. Where a pixel ends up does not depend on its value: the swaps are applied to an array of
    indices, which is the drawn parameter, and applying it to a batch is one gather on any device.

    The authors' code swaps views of an array, so that in a colour image p takes the colour of p + d while p + d keeps
    its own, and it truncates the first blur to 8 bits. ``faithful`` keeps both. ``corrected`` swaps the two and does
    not round. The values of a grey image are not views: they are swapped in either mode.

    Source: Hendrycks & Dietterich, ICLR 2019; for ``chance`` and ``down_only`` Mu & Gilmer 2019 (MNIST-C).

    >>> image = torch.zeros(1, 1, 8, 8)
    >>> image[..., 4:] = 1  # an edge, which becomes ragged
    >>> GlassBlur(((0.1, 1, 1),), "glass_blur")(image, level=1, indices=[0], seed=0)[0, 0, 2:5].round()
    tensor([[0., 1., 1., 0., 1., 1., 1., 1.],
            [0., 0., 0., 0., 0., 1., 1., 1.],
            [0., 0., 0., 1., 0., 1., 1., 1.]])

    Args:
        table: (σ in pixels, largest distance m, passes) for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
        mode: whether colours are copied (``faithful``) or swapped (``corrected``).
        chance: probability that a pixel is swapped at all: 1, and in MNIST-C 1/2.
        down_only: blur along columns alone, as MNIST-C's authors do by taking the columns of a grey image for channels;
            ``corrected`` blurs both ways.
    """

    mode: Mode = "faithful"
    chance: float = 1.0
    down_only: bool = False

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Int64[Tensor, "b h w"]:
        """The pixel ``row · w + column`` that each pixel takes its colour from."""
        _, reach, passes = self.row(level)
        channels, height, width = shape
        meetings = (passes, max(height - 2 * reach, 0), max(width - 2 * reach, 0))
        sources = torch.arange(height * width).repeat(len(indices), 1).view(-1, height, width)
        copies = self.mode == "faithful" and channels > 1
        for source, stream in zip(sources, self.streams(level, indices, seed), strict=True):
            moves = torch.randint(-reach, reach, (*meetings, 2), generator=stream)
            if self.chance < 1:  # a pixel that is swapped with itself stays
                moves *= (torch.rand(meetings, generator=stream, dtype=torch.float32) < self.chance)[..., None]
            _play(source.numpy(), moves.numpy(), reach, copies)
        return sources

    def apply(self, images: Images, level: float, params: Int64[Tensor, "b h w"]) -> Images:
        """Blur, let every pixel take its colour from the drawn one, and blur again."""
        sigma = self.row(level)[0]
        sigmas = (sigma, 0.0 if self.down_only and self.mode == "faithful" else sigma)
        work = images.to(torch.promote_types(images.dtype, torch.float32))
        blurred = gaussian_filter(work, sigmas)
        if self.mode == "faithful":
            blurred = to_bytes(blurred)
        places = params.to(images.device).flatten(1)[:, None].expand(-1, images.shape[1], -1)
        shuffled = blurred.flatten(2).gather(2, places).view_as(images)
        if self.mode == "faithful":
            shuffled = shuffled.to(work.dtype).div_(255)
        return gaussian_filter(shuffled, sigmas).clamp(0, 1).to(images.dtype)


@compiled
def _play(source, moves, reach, copies):  # type: ignore[no-untyped-def]
    passes, rows, columns, _ = moves.shape
    height, width = source.shape
    for turn in range(passes):
        for i in range(rows):
            for j in range(columns):
                y, x = height - reach - i, width - reach - j
                other_y, other_x = y + moves[turn, i, j, 1], x + moves[turn, i, j, 0]
                mine = source[y, x]
                source[y, x] = source[other_y, other_x]
                if not copies:
                    source[other_y, other_x] = mine


@dataclass(frozen=True)
class MotionBlur(BenchmarkCorruption[tuple[float, float], Tensor]):
    """A one-sided Gaussian along a line at an angle drawn from U(-45°, 45°).

    See :func:`~sextant.corruptions.filtering.motion_blur`.

    ImageMagick returns 8 bits, rounded to the nearest, and so does this.
    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> spot = torch.zeros(1, 1, 9, 9)
    >>> spot[..., 4, 4] = 1
    >>> blurred = MotionBlur(((3, 1.0),), "motion_blur")(spot, level=1, indices=[0], seed=0)
    >>> blurred.max() < 1, (blurred > 0).sum() > 1
    (tensor(True), tensor(True))

    Args:
        table: (radius, σ) in pixels for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Float[Tensor, "b"]:
        """The angles in degrees."""
        degrees = torch.empty(len(indices), dtype=torch.float64)
        for angle, stream in zip(degrees, self.streams(level, indices, seed), strict=True):
            angle.uniform_(-45, 45, generator=stream)
        return degrees

    def apply(self, images: Images, level: float, params: Float[Tensor, "b"]) -> Images:
        """Blur each image along its angle."""
        return eight_bit(motion_blur(images, *self.row(level), params), "corrected")


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
    r"""The mean of the image and its magnifications.

    .. math:: y = \frac{1}{n + 1} \Bigl(x + \sum_{i=1}^{n} Z_{z_i} x\Bigr), \qquad z_i = 1, 1 + δ, \ldots < z_{end}

    with :math:`Z_z x = A_z x B_z^T` the clipped zoom. All zooms together take two matrix products, one for each side.

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

    def apply(self, images: Images, level: float, params: None) -> Images:
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
