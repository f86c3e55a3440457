"""Soft white lines across an image, in the coordinates of an MNIST digit."""

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

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
