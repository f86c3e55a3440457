"""A zigzag across the image."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.shapes.line_overlay import SIDE, line_overlay

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

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Int64[Tensor, "b 2"]:
        """Row of the start, 0 to 26, and the rise, -5 to 4."""
        streams = self.streams(level, indices, seed)
        starts = [torch.randint(SIDE - 1, (1,), generator=stream) for stream in streams]
        rises = [torch.randint(-RISE, RISE, (1,), generator=stream) for stream in streams]
        return torch.stack([torch.cat(starts), torch.cat(rises)], -1)

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Int64[Tensor, "b 2"]
    ) -> Float[Tensor, "b c h w"]:
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
