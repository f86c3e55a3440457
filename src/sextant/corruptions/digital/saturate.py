r"""Change of saturation in the HSV colour model.

With hue and value :math:`V = \max(r, g, b)` kept, a new saturation S' in the place of
:math:`S = (V - \min(r, g, b)) / V` moves every channel to :math:`V - (V - x)\, S'/S`. So no conversion is needed.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode


@dataclass(frozen=True)
class Saturate(BenchmarkCorruption[tuple[float, float], None]):
    """``S' = clip(c₀ S + c₁)`` in HSV.

    A grey pixel of a colour image has no hue, and its saturation cannot be raised: ``corrected`` leaves it as it is.
    The authors' conversion gives it the hue 0, and with c₁ > 0 it turns reddish: ``faithful`` keeps that. An image of
    one channel has no colour and is returned as it is.

    Source: Hendrycks & Dietterich, ICLR 2019 (an extra corruption, for validation). The published rows are not in the
    order of their effect: the first two take colour away, the others add to it.

    >>> reddish = torch.tensor([0.8, 0.4, 0.4]).view(1, 3, 1, 1)
    >>> Saturate(((0.5, 0.0),), "saturate")(reddish, level=1, indices=[0], seed=0).flatten()  # half the saturation
    tensor([0.8000, 0.6000, 0.6000])

    Args:
        table: (c₀, c₁) for each severity.
        name: the corruption's name.
        levels: the severities to test at.
        mode: how grey pixels are treated.
    """

    mode: Mode = "faithful"

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Move every channel away from, or towards, the value of its pixel."""
        if images.shape[1] == 1:
            return images.clone()
        factor, shift = self.row(level)
        work = images.to(torch.promote_types(images.dtype, torch.float32))  # half precision has no 1e-12
        value = work.amax(1, keepdim=True)
        spread = value - work.amin(1, keepdim=True)
        saturation = spread / value.clamp(min=1e-12)
        wanted = (saturation * factor + shift).clamp(0, 1)
        coloured = value - (value - work) * (wanted / saturation.clamp(min=1e-12))
        red = torch.tensor([0.0, 1.0, 1.0], device=work.device, dtype=work.dtype)[:, None, None]
        grey = value * (1 - wanted * red) if self.mode == "faithful" else work
        return torch.where(spread > 0, coloured, grey).clamp(0, 1).to(images.dtype)
