"""Salt-and-pepper noise."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int8, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption


@dataclass(frozen=True)
class ImpulseNoise(BenchmarkCorruption[float, Tensor]):
    """Each value, independently, becomes 0 with probability p/2 and 1 with probability p/2.

    Source: Hendrycks & Dietterich, ICLR 2019; their ``skimage.util.random_noise`` treats the channels of a pixel
    independently, and so does this.

    >>> grey = torch.full((1, 1, 2, 4), 0.5)
    >>> ImpulseNoise((0.5,), "impulse_noise")(grey, level=1, indices=[0], seed=0)
    tensor([[[[0.5000, 0.5000, 0.5000, 0.5000],
              [0.5000, 1.0000, 0.0000, 1.0000]]]])

    Args:
        table: p for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Int8[Tensor, "b c h w"]:
        """-1 where a value becomes black, 1 where white, 0 where it stays."""
        share = torch.empty(len(indices), *shape)
        for image, stream in zip(share, self.streams(level, indices, seed), strict=True):
            image.uniform_(generator=stream)
        amount = self.row(level)
        return (share < amount).to(torch.int8) - 2 * (share < amount / 2).to(torch.int8)

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Int8[Tensor, "b c h w"]
    ) -> Float[Tensor, "b c h w"]:
        """Set the drawn values to black and white."""
        return (images + 2 * params.to(images)).clamp(0, 1)
