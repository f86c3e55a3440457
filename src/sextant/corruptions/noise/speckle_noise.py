"""Speckle noise: noise in proportion to the image."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from sextant.corruptions.noise.clipped_gaussian_noise import ClippedGaussianNoise


@dataclass(frozen=True)
class SpeckleNoise(ClippedGaussianNoise):
    """``y = clip(x + σ x n)`` with ``n ~ N(0, 1)`` independent at every value.

    Source: Hendrycks & Dietterich, ICLR 2019 (an extra corruption, for validation).

    >>> import torch
    >>> image = torch.tensor([0.0, 0.1, 0.5]).view(1, 1, 1, 3)
    >>> SpeckleNoise((0.2,), "speckle_noise")(image, level=1, indices=[0], seed=0)  # black stays black
    tensor([[[[0.0000, 0.0956, 0.4346]]]])

    Args:
        table: σ for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float[Tensor, "b c h w"]
    ) -> Float[Tensor, "b c h w"]:
        """Add the drawn noise times the image, and clip."""
        return super().apply(images, level, params.to(images) * images)
