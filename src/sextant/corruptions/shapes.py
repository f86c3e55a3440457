"""Shapes: MNIST-C's motions of a digit, lines over it, and its edges."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from skimage.feature import canny
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.contract import Images, Positions
from sextant.corruptions.filtering import bilinear
from sextant.corruptions.pixels import luma


def random_signs(streams: list[torch.Generator], count: int) -> Float64[Tensor, "b count"]:
    """``count`` values of -1 or 1 from each stream, equally likely.

    Example:
        >>> signs = random_signs([torch.Generator().manual_seed(seed) for seed in (0, 1)], 100)
        >>> signs.shape, signs.unique()
        (torch.Size([2, 100]), tensor([-1.,  1.], dtype=torch.float64))
    """
    signs = [torch.randint(2, (count,), generator=stream) for stream in streams]
    return torch.stack(signs).double() * 2 - 1


def affine_warp(images: Images, matrices: Float[Tensor, "b 2 2"], shifts: Float[Tensor, "b 2"] | None = None) -> Images:
    """``y(p) = x(A (p - o) + o + t)`` with p = (column, row) in pixels and o the image's centre, bilinear.

    The matrix maps the result into the image, as an inverse map does. What lies outside the image is 0, except within
    one pixel of its border, where it fades.

    Args:
        images: images to warp.
        matrices: A of each image.
        shifts: t of each image, in pixels to the right and down.

    Example:
        >>> image = torch.tensor([[[[1.0, 2.0, 3.0]]]])
        >>> affine_warp(image, torch.tensor([[[-1.0, 0.0], [0.0, 1.0]]])).flatten()  # columns the other way round
        tensor([3., 2., 1.])
        >>> affine_warp(image, torch.eye(2)[None], torch.tensor([[1.0, 0.0]])).flatten()  # from one pixel to the right
        tensor([2., 3., 0.])
    """
    height, width = images.shape[-2:]
    centre = torch.tensor([(width - 1) / 2, (height - 1) / 2], dtype=torch.float64)
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    points = torch.stack([columns, rows], -1) - centre
    sources = torch.einsum("bij,hwj->bhwi", matrices.double(), points) + centre
    if shifts is not None:
        sources = sources + shifts.double()[:, None, None]
    # computed in double precision on the CPU, so that whole pixels are whole on every device
    sources = sources.to(images)
    return bilinear(images, sources[..., 1], sources[..., 0], "zero")


SIDE = 28
REACH = 2.3  # pixels at which a line has faded


def mnist_coordinates(size: int) -> Float64[Tensor, "size"]:
    """Positions of the pixels of an axis of ``size`` among 28, whose first has its centre at 0.

    Example:
        >>> mnist_coordinates(2)  # each covers 14 pixels, 0 to 13 and 14 to 27
        tensor([ 6.5000, 20.5000], dtype=torch.float64)
    """
    return (torch.arange(size, dtype=torch.float64) + 0.5) * SIDE / size - 0.5


def mnist_cells(size: int) -> Int64[Tensor, "size"]:
    """Which of 28 pixels each of the pixels of an axis of ``size`` lies in.

    Example:
        >>> mnist_cells(4)  # each covers 7 pixels, of which it is in the middle one
        tensor([ 3, 10, 17, 24])
    """
    return (torch.arange(size) * 2 + 1) * SIDE // (2 * size)


def line_overlay(
    starts: Float64[Tensor, "*batch 2"], ends: Float64[Tensor, "*batch 2"], height: int, width: int
) -> Float64[Tensor, "*batch h w"]:
    """One line each, from ``starts`` to ``ends``, both (column, row) in pixels of a 28x28 image.

        y = 1 + log(1 - d/2.3), at least 0,     d = vertical distance to the line,

    in the columns from ``floor(start)`` up to ``ceil(end)``, without the latter. A line without width is not drawn.
    Other sizes show the same line, scaled.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    Example:
        >>> ends = torch.tensor([[4.0, 14.0], [24.0, 14.0]], dtype=torch.float64)
        >>> line = line_overlay(ends[0], ends[1], 28, 28)
        >>> line[12:17, 10].round(decimals=2), (line[14] == 1).sum()  # across the line: 1 + log(1 - 1 / 2.3) beside it
        (tensor([0.0000, 0.4300, 1.0000, 0.4300, 0.0000], dtype=torch.float64), tensor(20))
    """
    columns, rows = mnist_coordinates(width), mnist_coordinates(height)[:, None]
    cells = mnist_cells(width)
    (c0, r0), (c1, r1) = (points[..., None, None].unbind(-3) for points in (starts, ends))
    run = torch.where(c1 == c0, 1.0, c1 - c0)
    line = r0 + (r1 - r0) / run * (columns - c0)
    distance = (rows - line).abs().clamp(max=REACH - 1e-10)
    value = (1 + torch.log1p(-distance / REACH)).clamp(min=0)
    return value.where((cells >= c0.floor()) & (cells < c1.ceil()) & (c0 != c1), 0)


class ByAngle(BenchmarkCorruption[float, Tensor]):
    """By an angle φ of a random sign; the table holds |φ| in radians."""

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Float64[Tensor, "b"]:
        """φ of each image."""
        return self.row(level) * random_signs(self.streams(level, indices, seed), 1)[:, 0]


@dataclass(frozen=True)
class Shear(ByAngle):
    """``y(p) = x(A p)`` about the centre, sheared along the rows by φ with a random sign.

    Bilinear, black outside.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> image = torch.zeros(1, 1, 5, 5)
    >>> image[..., 2] = 1  # an upright line, which leans
    >>> Shear((torch.pi / 4,), "shear", mode="corrected")(image, level=1, indices=[0], seed=0)
    tensor([[[[1., 0., 0., 0., 0.],
              [0., 1., 0., 0., 0.],
              [0., 0., 1., 0., 0.],
              [0., 0., 0., 1., 0.],
              [0., 0., 0., 0., 1.]]]])

    Args:
        table: |φ| in radians for each severity.
        mode: ``faithful`` has ``A = [[1, -sin φ], [0, cos φ]]``, scikit-image's shear at the time; it turns the column
            axis, and so also magnifies by 1/cos φ down the columns. ``corrected`` is a true shear,
            ``A = [[1, -tan φ], [0, 1]]``, which keeps areas.
    """

    mode: Mode = "faithful"

    def apply(self, images: Images, level: float, params: Float64[Tensor, "b"]) -> Images:
        """Shear by the drawn angles."""
        one, none = torch.ones_like(params), torch.zeros_like(params)
        across, down = (torch.sin(params), torch.cos(params)) if self.mode == "faithful" else (torch.tan(params), one)
        matrices = torch.stack([one, -across, none, down], -1).unflatten(-1, (2, 2))
        return affine_warp(images, matrices).clamp(0, 1)


@dataclass(frozen=True)
class Scale(BenchmarkCorruption[float, None]):
    """``y(p) = x(f·p)`` about the centre: smaller by f > 1, larger by f < 1. Bilinear, black outside.

    Nothing is random.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> Scale((2.0,), "scale")(torch.ones(1, 1, 8, 8), level=1, indices=[0], seed=0).mean()  # a quarter of the area
    tensor(0.2500)

    Args:
        table: f for each severity.
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Scale."""
        matrices = (self.row(level) * torch.eye(2, dtype=torch.float64)).expand(len(images), 2, 2)
        return affine_warp(images, matrices).clamp(0, 1)


@dataclass(frozen=True)
class Rotate(ByAngle):
    """``y(p) = x(R p)`` about the centre, ``R = [[cos φ, -sin φ], [sin φ, cos φ]]``, with a random sign of φ.

    With rows downward, φ > 0 turns the picture counter-clockwise. Bilinear, black outside.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> image = torch.tensor([[[[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]]])
    >>> Rotate((torch.pi / 2,), "rotate")(image, level=1, indices=[0], seed=0).round().abs()
    tensor([[[[0., 0., 0.],
              [1., 0., 0.],
              [0., 0., 0.]]]])

    Args:
        table: |φ| in radians for each severity.
    """

    def apply(self, images: Images, level: float, params: Float64[Tensor, "b"]) -> Images:
        """Turn by the drawn angles."""
        cosine, sine = torch.cos(params), torch.sin(params)
        matrices = torch.stack([cosine, -sine, sine, cosine], -1).unflatten(-1, (2, 2))
        return affine_warp(images, matrices).clamp(0, 1)


@dataclass(frozen=True)
class Translate(BenchmarkCorruption[float, Tensor]):
    """``y(p) = x(p + (±t, ±t))``, with a random sign for each axis; black enters from outside.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> image = torch.zeros(1, 1, 5, 5)
    >>> image[..., 2, 2] = 1
    >>> Translate((1.0,), "translate")(image, level=1, indices=[0], seed=0).nonzero()[:, 2:]
    tensor([[3, 3]])

    Args:
        table: t in pixels for each severity.
    """

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Float64[Tensor, "b 2"]:
        """Shifts of each image to the right and down."""
        return self.row(level) * random_signs(self.streams(level, indices, seed), 2)

    def apply(self, images: Images, level: float, params: Float64[Tensor, "b 2"]) -> Images:
        """Shift."""
        matrices = torch.eye(2, dtype=torch.float64).expand(len(images), 2, 2)
        return affine_warp(images, matrices, params)


@dataclass(frozen=True)
class Stripe(BenchmarkCorruption[tuple[()], None]):
    """``y = 1 - x`` in the first and the last quarter of the columns (0 to 6 and 21 to 27 of 28), x between them.

    Nothing is random, and there is one severity.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> Stripe(((),), "stripe")(torch.zeros(1, 1, 1, 8), level=1, indices=[0], seed=0)
    tensor([[[[1., 1., 0., 0., 0., 0., 1., 1.]]]])
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Invert the stripes."""
        self.row(level)
        cell = mnist_cells(images.shape[-1]).to(images.device)
        return torch.where((cell < 7) | (cell >= 21), 1 - images, images)


@dataclass(frozen=True)
class DottedLine(BenchmarkCorruption[tuple[()], Tensor]):
    """A soft line from the left edge to the right, its ends at random heights, in dots of two columns of 28.

    There is one severity.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> dotted = DottedLine(((),), "dotted_line")(torch.zeros(1, 1, 28, 28), level=1, indices=[0], seed=0)
    >>> dotted.amax((0, 1, 2))[:8] > 0  # two columns of each four
    tensor([False, False,  True,  True, False, False,  True,  True])
    """

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Int64[Tensor, "b 2"]:
        """Rows of the ends, 0 to 26."""
        streams = self.streams(level, indices, seed)
        return torch.stack([torch.randint(SIDE - 1, (2,), generator=stream) for stream in streams])

    def apply(self, images: Images, level: float, params: Int64[Tensor, "b 2"]) -> Images:
        """Add the drawn lines."""
        self.row(level)
        height, width = images.shape[-2:]
        left, right = params.double().unbind(-1)
        starts = torch.stack([torch.zeros_like(left), left], -1)
        ends = torch.stack([torch.full_like(right, SIDE - 1), right], -1)
        line = line_overlay(starts, ends, height, width) * (mnist_cells(width) // 2 % 2)
        return (images + line[:, None].to(images)).clamp(0, 1)


FIRST, LAST = 2, 25  # columns of the ends
STEP = HEIGHT = 2.0  # a quarter of a period, and the amplitude
TURNS = 6  # peaks of every line from column 2 to 25 that rises by 5 or less
RISE = 5


@dataclass(frozen=True)
class Zigzag(BenchmarkCorruption[tuple[()], Tensor]):
    """A triangle wave of amplitude 2 and period 8 along a line from column 2 to column 25, in pixels of a 28x28 image.

    The line starts at a random row and rises or falls by up to 5. There is one severity.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> Zigzag(((),), "zigzag").corners(torch.tensor([[10, 0]]))[0, :4]  # from row 10, level
    tensor([[ 2., 10.],
            [ 4., 12.],
            [ 8.,  8.],
            [12., 12.]], dtype=torch.float64)

    Args:
        mode: ``faithful`` ends the wave where the published formula does: ``h / (2 (d - m))`` off the line, for a line
            of length d with m the last whole half period and h = -2. ``corrected`` ends it on the wave.
    """

    mode: Mode = "faithful"

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Int64[Tensor, "b 2"]:
        """Row of the start, 0 to 26, and the rise, -5 to 4."""
        streams = self.streams(level, indices, seed)
        starts = [torch.randint(SIDE - 1, (1,), generator=stream) for stream in streams]
        rises = [torch.randint(-RISE, RISE, (1,), generator=stream) for stream in streams]
        return torch.stack([torch.cat(starts), torch.cat(rises)], -1)

    def apply(self, images: Images, level: float, params: Int64[Tensor, "b 2"]) -> Images:
        """Add the drawn zigzags."""
        self.row(level)
        corners = self.corners(params)
        lines = line_overlay(corners[:, :-1], corners[:, 1:], *images.shape[-2:])
        return (images + lines.sum(1, keepdim=True).to(images)).clamp(0, 1)

    def corners(self, params: Int64[Tensor, "b 2"]) -> Float64[Tensor, "b 8 2"]:
        """The wave's corners, (column, row) in pixels of a 28x28 image."""
        start, rise = params.double().unbind(-1)
        angle = torch.atan2(rise, torch.full_like(rise, LAST - FIRST))
        length = (LAST - FIRST) / torch.cos(angle)
        along, off = torch.zeros(2, len(params), TURNS + 2, dtype=torch.float64)
        for turn in range(TURNS):
            along[:, turn + 1] = (2 * turn + 1) * STEP
            off[:, turn + 1] = HEIGHT * (-1) ** turn
        along[:, -1] = length
        if self.mode == "faithful":
            off[:, -1] = off[:, -2] / (2 * (length - 2 * STEP * torch.floor(length / (2 * STEP))))
        else:
            off[:, -1] = off[:, -2] * (1 - (length - along[:, -2]) / STEP)
        cosine, sine = torch.cos(angle)[:, None], torch.sin(angle)[:, None]
        columns = FIRST + cosine * along - sine * off
        rows = start[:, None] + sine * along + cosine * off
        return torch.stack([columns, rows], -1)


@dataclass(frozen=True)
class CannyEdges(BenchmarkCorruption[tuple[()], None]):
    """1 on the edges that Canny's detector finds, 0 elsewhere; every channel shows the edges of the luma.

    This is scikit-image's detector with its defaults (σ = 1, thresholds 0.1 and 0.2), as in the benchmark. Nothing is
    random, and there is one severity.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> square = torch.zeros(1, 1, 16, 16)
    >>> square[..., 4:12, 4:12] = 1
    >>> CannyEdges(((),), "canny_edges")(square, level=1, indices=[0], seed=0)[0, 0, 7].nonzero().flatten()
    tensor([ 4, 11])
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Find the edges, on the CPU whatever the device."""
        self.row(level)
        # grey levels as exact as 8-bit images have them: single precision would break ties between neighbours
        grey = np.round(luma(images)[:, 0].detach().double().cpu().numpy() * 255, 3) / 255
        edges = np.stack([canny(one) for one in grey])
        return torch.from_numpy(edges)[:, None].to(images).expand_as(images).contiguous()
