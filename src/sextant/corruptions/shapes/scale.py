"""Shrinking about the image's centre."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.shapes.affine_warp import affine_warp


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

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Scale."""
        matrices = (self.row(level) * torch.eye(2, dtype=torch.float64)).expand(len(images), 2, 2)
        return affine_warp(images, matrices).clamp(0, 1)
