"""Gaussian blur of the benchmark sets."""

from dataclasses import dataclass

from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.filtering.gaussian_filter import gaussian_filter


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

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Smooth over height and width."""
        return gaussian_filter(images, self.row(level)).clamp(0, 1)
