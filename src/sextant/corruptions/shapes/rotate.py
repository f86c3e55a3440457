"""Rotation about the image's centre."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.shapes.affine_warp import affine_warp
from sextant.corruptions.shapes.signs import random_signs


@dataclass(frozen=True)
class Rotate(BenchmarkCorruption[float, Tensor]):
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

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Float64[Tensor, "b"]:
        """φ of each image."""
        return self.row(level) * random_signs(self.streams(level, indices, seed), 1)[:, 0]

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float64[Tensor, "b"]
    ) -> Float[Tensor, "b c h w"]:
        """Turn by the drawn angles."""
        cosine, sine = torch.cos(params), torch.sin(params)
        matrices = torch.stack([cosine, -sine, sine, cosine], -1).unflatten(-1, (2, 2))
        return affine_warp(images, matrices).clamp(0, 1)
