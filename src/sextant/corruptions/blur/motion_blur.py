"""Motion blur: a moving camera."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.eight_bit import eight_bit
from sextant.corruptions.filtering.motion_kernel import motion_blur


@dataclass(frozen=True)
class MotionBlur(BenchmarkCorruption[tuple[float, float], Tensor]):
    """A one-sided Gaussian along a line at an angle drawn from U(-45°, 45°); see :mod:`.motion_kernel`.

    ImageMagick returns 8 bits, rounded to the nearest, and so does this.
    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> spot = torch.zeros(1, 1, 9, 9)
    >>> spot[..., 4, 4] = 1
    >>> blurred = MotionBlur(((3, 1.0),), "motion_blur")(spot, level=1, indices=[0], seed=0)
    >>> blurred.max() < 1, (blurred > 0).sum() > 1
    (tensor(True), tensor(True))

    Args:
        table: (radius, σ) in pixels for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> Float[Tensor, "b"]:
        """The angles in degrees."""
        degrees = torch.empty(len(indices), dtype=torch.float64)
        for angle, stream in zip(degrees, self.streams(level, indices, seed), strict=True):
            angle.uniform_(-45, 45, generator=stream)
        return degrees

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float[Tensor, "b"]
    ) -> Float[Tensor, "b c h w"]:
        """Blur each image along its angle."""
        return eight_bit(motion_blur(images, *self.row(level), params), "corrected")
