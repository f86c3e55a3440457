"""Additive Gaussian noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.corruption import Corruption
from sextant.corruptions.seeding import generators, image_seeds


@dataclass(frozen=True)
class GaussianNoise(Corruption[Tensor]):
    """``y = x + n`` with ``n ~ N(0, variance)`` independent at every value.

    Source: Strisciuglio et al. 2020, section 4.1 (MNIST); the paper does not clip.

    >>> noisy = GaussianNoise([0.01])(torch.zeros(2, 1, 28, 28), level=0.01, indices=[0, 1], seed=0)
    >>> noisy.std()  # the root of the variance
    tensor(0.0990)

    Args:
        levels: noise variances, at least 0.
        clip: clip the result to [0, 1].
        name: the corruption's name.
    """

    levels: Sequence[float]
    clip: bool = False
    name: str = "gaussian"

    def check_level(self, level: float) -> None:
        """Raise a ``ValueError`` unless ``level`` is a variance."""
        super().check_level(level)
        if level < 0:
            raise ValueError(f"a level of {self.name} is a variance, at least 0, not {level!r}")

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Float[Tensor, "b c h w"]:
        """The noise itself."""
        noise = torch.empty(len(indices), *shape)
        for image, generator in zip(noise, generators(image_seeds(self.name, level, indices, seed)), strict=True):
            image.normal_(std=math.sqrt(level), generator=generator)
        return noise

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float[Tensor, "b c h w"]
    ) -> Float[Tensor, "b c h w"]:
        """Add the drawn noise."""
        noisy = images + params.to(images)
        return noisy.clamp(0, 1) if self.clip else noisy
