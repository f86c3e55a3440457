"""Photon noise."""

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
