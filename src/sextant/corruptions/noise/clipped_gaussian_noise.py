"""Additive Gaussian noise of the benchmark sets."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption


@dataclass(frozen=True)
class ClippedGaussianNoise(BenchmarkCorruption[float, Tensor]):
    """``y = clip(x + σ n)`` with ``n ~ N(0, 1)`` independent at every value.

    Source: Hendrycks & Dietterich, ICLR 2019. :class:`~sextant.corruptions.GaussianNoise` takes variances, and its
    clipping is optional.

    >>> grey = torch.full((1, 1, 28, 28), 0.5)
    >>> ClippedGaussianNoise((0.1,), "gaussian_noise")(grey, level=1, indices=[0], seed=0).std()
    tensor(0.1005)

    Args:
        table: standard deviation σ for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Float[Tensor, "b c h w"]:
        """The standard normal ``n``."""
        noise = torch.empty(len(indices), *shape)
        for image, stream in zip(noise, self.streams(level, indices, seed), strict=True):
            image.normal_(generator=stream)
        return noise

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float[Tensor, "b c h w"]
    ) -> Float[Tensor, "b c h w"]:
        """Add the drawn noise and clip."""
        return (images + self.row(level) * params.to(images)).clamp(0, 1)
