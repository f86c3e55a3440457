"""Shot noise: photon counts."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.seeding import generators, image_seeds


@dataclass(frozen=True)
class ShotNoise(BenchmarkCorruption[float, list[int]]):
    """``y = clip(Poisson(c x) / c)``, so that the variance is ``x / c`` before clipping.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> grey = torch.full((1, 1, 1, 6), 0.5)
    >>> ShotNoise((10.0,), "shot_noise")(grey, level=1, indices=[0], seed=0)  # whole tenths
    tensor([[[[0.6000, 0.4000, 0.7000, 0.8000, 0.2000, 0.2000]]]])

    Args:
        table: photon count c of a white pixel for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> list[int]:
        """The seeds of the photon streams: counts depend on the image, so the stream is the parameter."""
        return image_seeds(self.name, level, indices, seed)

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: list[int]) -> Float[Tensor, "b c h w"]:
        """Count photons from the drawn streams, on the CPU."""
        peak = self.row(level)
        rates = (images.float() * peak).clamp(min=0).cpu()
        counts = [torch.poisson(rate, stream) for rate, stream in zip(rates, generators(params), strict=True)]
        return (torch.stack(counts) / peak).clamp(0, 1).to(images)
