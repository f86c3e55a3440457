"""A dotted line across the image."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.shapes.line_overlay import SIDE, line_overlay, mnist_cells


@dataclass(frozen=True)
class DottedLine(BenchmarkCorruption[tuple[()], Tensor]):
    """A soft line from the left edge to the right, its ends at random heights, in dots of two columns of 28.

    There is one severity.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> dotted = DottedLine(((),), "dotted_line")(torch.zeros(1, 1, 28, 28), level=1, indices=[0], seed=0)
    >>> dotted.amax((0, 1, 2))[:8] > 0  # two columns of each four
    tensor([False, False,  True,  True, False, False,  True,  True])
    """

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Int64[Tensor, "b 2"]:
        """Rows of the ends, 0 to 26."""
        streams = self.streams(level, indices, seed)
        return torch.stack([torch.randint(SIDE - 1, (2,), generator=stream) for stream in streams])

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Int64[Tensor, "b 2"]
    ) -> Float[Tensor, "b c h w"]:
        """Add the drawn lines."""
        self.row(level)
        height, width = images.shape[-2:]
        left, right = params.double().unbind(-1)
        starts = torch.stack([torch.zeros_like(left), left], -1)
        ends = torch.stack([torch.full_like(right, SIDE - 1), right], -1)
        line = line_overlay(starts, ends, height, width) * (mnist_cells(width) // 2 % 2)
        return (images + line[:, None].to(images)).clamp(0, 1)
