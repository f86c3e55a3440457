"""Two inverted stripes."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.shapes.line_overlay import mnist_cells


@dataclass(frozen=True)
class Stripe(BenchmarkCorruption[tuple[()], None]):
    """``y = 1 - x`` in the first and the last quarter of the columns (0 to 6 and 21 to 27 of 28), x between them.

    Nothing is random, and there is one severity.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> Stripe(((),), "stripe")(torch.zeros(1, 1, 1, 8), level=1, indices=[0], seed=0)
    tensor([[[[1., 1., 0., 0., 0., 0., 1., 1.]]]])
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Invert the stripes."""
        self.row(level)
        cell = mnist_cells(images.shape[-1]).to(images.device)
        return torch.where((cell < 7) | (cell >= 21), 1 - images, images)
