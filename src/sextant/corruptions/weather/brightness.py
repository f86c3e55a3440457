r"""Brightness, as the value V of the HSV colour model.

With hue and saturation kept, adding c to :math:`V = \max(r, g, b)` multiplies every channel by
:math:`\min(V + c, 1) / V`; a black pixel, which has no hue and no saturation, becomes grey. So no conversion is needed.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption


@dataclass(frozen=True)
class Brightness(BenchmarkCorruption[float, None]):
    """``V' = clip(V + c)`` in HSV; for a grey image, ``y = clip(x + c)``.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> colour = torch.tensor([0.4, 0.2, 0.1]).view(1, 3, 1, 1)
    >>> Brightness((0.2,), "brightness")(colour, level=1, indices=[0], seed=0).flatten()  # the hue stays
    tensor([0.6000, 0.3000, 0.1500])

    Args:
        table: c for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Raise the value, keeping hue and saturation."""
        work = images.to(torch.promote_types(images.dtype, torch.float32))  # half precision has no 1e-12
        value = work.amax(1, keepdim=True)
        raised = (value + self.row(level)).clamp(0, 1)
        bright = torch.where(value > 0, work * (raised / value.clamp(min=1e-12)), raised)
        return bright.clamp(0, 1).to(images.dtype)
