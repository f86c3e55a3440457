"""Shear about the image's centre."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.shapes.affine_warp import affine_warp
from sextant.corruptions.shapes.signs import random_signs


@dataclass(frozen=True)
class Shear(BenchmarkCorruption[float, Tensor]):
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

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Float64[Tensor, "b"]:
        """φ of each image."""
        return self.row(level) * random_signs(self.streams(level, indices, seed), 1)[:, 0]

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float64[Tensor, "b"]
    ) -> Float[Tensor, "b c h w"]:
        """Shear by the drawn angles."""
        one, none = torch.ones_like(params), torch.zeros_like(params)
        across, down = (torch.sin(params), torch.cos(params)) if self.mode == "faithful" else (torch.tan(params), one)
        matrices = torch.stack([one, -across, none, down], -1).unflatten(-1, (2, 2))
        return affine_warp(images, matrices).clamp(0, 1)
