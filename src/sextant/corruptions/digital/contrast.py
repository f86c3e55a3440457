"""Loss of contrast."""

from dataclasses import dataclass

from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption


@dataclass(frozen=True)
class Contrast(BenchmarkCorruption[float, None]):
    """``y = clip((x - m) c + m)`` with m the image's mean in each channel.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> import torch
    >>> Contrast((0.5,), "contrast")(torch.tensor([[[[0.2, 0.6]]]]), level=1, indices=[0], seed=0)
    tensor([[[[0.3000, 0.5000]]]])

    Args:
        table: c for each severity; 1 changes nothing.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Draw every value to the mean of its channel."""
        return images.mean((2, 3), keepdim=True).lerp(images, self.row(level)).clamp(0, 1)
