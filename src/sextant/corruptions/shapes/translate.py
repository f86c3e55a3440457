"""A shift along both axes."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.shapes.affine_warp import affine_warp
from sextant.corruptions.shapes.signs import random_signs


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

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Float64[Tensor, "b 2"]:
        """Shifts of each image to the right and down."""
        return self.row(level) * random_signs(self.streams(level, indices, seed), 2)

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float64[Tensor, "b 2"]
    ) -> Float[Tensor, "b c h w"]:
        """Shift."""
        matrices = torch.eye(2, dtype=torch.float64).expand(len(images), 2, 2)
        return affine_warp(images, matrices, params)
