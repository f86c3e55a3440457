r"""Tolerance to the position of a part, which grows with its distance from the filter's centre.

.. math:: \sigma(\rho) = \sigma_0 + \alpha\rho; \qquad
    \text{max}:\; \max_d r(x + d)\, e^{-\lVert d\rVert^2 / 2\sigma^2}, \qquad
    \text{sum}:\; \sum_d r(x + d)\, g_\sigma(d)

Source: Azzopardi and Petkov 2013, section 2.4; published programs differ in how far a blur reaches.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

import torch
import torch.nn.functional as F
from annotated_types import Ge
from jaxtyping import Float
from torch import Tensor

from sextant.layers.floating import require_floating
from sextant.ranges import NonNegative, fits

#: black; the border's value; mirrored without repeating the border's pixel; the opposite side
Border = Literal["zeros", "replicate", "reflect", "circular"]


def padded(maps: Float[Tensor, "*b h w"], margin: int, border: Border, fill: float = 0.0) -> Float[Tensor, "*b H W"]:
    """Pad maps by ``margin``, of any size, on every side: mirrored and circular borders repeat as often as needed.

    Args:
        fill: value beyond a border of ``zeros``.
    """
    if border == "zeros":
        return F.pad(maps, (margin,) * 4, value=fill)
    wide = maps.reshape(-1, 1, *maps.shape[-2:])
    x, y = margin, margin
    while x or y:
        # as much as the maps can supply at a time; a mirror of a single line can only repeat that line
        height, width = (size - (border == "reflect") for size in wide.shape[-2:])
        mode, dx, dy = border, min(x, width), min(y, height)
        if border == "replicate" or not (dx or dy):
            mode, dx, dy = "replicate", x, y
        wide = F.pad(wide, (dx, dx, dy, dy), mode=mode)
        x, y = x - dx, y - dy
    return wide.reshape(*maps.shape[:-2], *wide.shape[-2:])


#: pixels that a CPU blurs at a time, so that they and their results stay in its cache
BLOCK = 2**16


@dataclass(frozen=True)
class Blur:
    """How the maps of a filter are blurred.

    >>> line = torch.tensor([[0.0, 0.0, 1.0, 0.0, 0.0]])
    >>> Blur(reach=1.0)(line, sigma=1.0)
    tensor([[0.0000, 0.6065, 1.0000, 0.6065, 0.0000]])

    Args:
        sigma0, alpha: σ(ρ) = sigma0 + alpha ρ, in pixels of the maps.
        kind: ``max`` (weights are not normalised) or ``sum``.
        reach: the blur ends ``round(reach * sigma)`` pixels away; a sum is 2 reach σ long, made odd.
        fixed_reach: the same reach in pixels for every σ instead.
        border: how maps continue beyond their border; for ``max`` nothing lies there.

    Raises:
        ValueError: sigma0, alpha or reach is negative or not finite, fixed_reach not a whole number, or kind or border
            unknown.
    """

    sigma0: float = 0.67
    alpha: float = 0.1
    kind: Literal["max", "sum"] = "max"
    reach: float = 3.0
    fixed_reach: int | None = None
    border: Border = "zeros"

    def __post_init__(self) -> None:
        numbers = all(fits(NonNegative, value) for value in (self.sigma0, self.alpha, self.reach))
        if not numbers or not fits(Annotated[int, Ge(0)] | None, self.fixed_reach) or self.kind not in ("max", "sum"):
            raise ValueError(
                f"blur needs sigma0, alpha and reach >= 0 and finite, fixed_reach a whole number >= 0 or None, "
                f"and kind max or sum; got {self}"
            )
        if self.border not in get_args(Border):
            raise ValueError(f"border must be one of {', '.join(get_args(Border))}; got {self.border!r}")

    def __call__(self, maps: Float[Tensor, "*b h w"], sigma: float) -> Float[Tensor, "*b h w"]:
        """Maps blurred by one σ; 0 leaves them as they are."""
        if sigma == 0:
            return maps
        reach = self.fixed_reach
        if reach is None:
            reach = _rounded(self.reach * sigma) if self.kind == "max" else _rounded(2 * self.reach * sigma) // 2
        if self.kind == "max":
            return max_blur(maps, sigma, reach)
        return gaussian_blur(maps, sigma, reach, self.border)


def max_blur(maps: Float[Tensor, "*b h w"], sigma: float, reach: int) -> Float[Tensor, "*b h w"]:
    """The maximum over the neighbours within ``reach``, each weighted by exp(-d²/2σ²); maps must not be negative.

    >>> line = torch.tensor([[0.0, 0.0, 1.0, 0.0, 0.0]])
    >>> max_blur(line, sigma=1.0, reach=1)
    tensor([[0.0000, 0.6065, 1.0000, 0.6065, 0.0000]])
    """
    whole = maps.reshape(-1, *maps.shape[-2:])
    block = max(1, BLOCK // maps.shape[-2:].numel()) if maps.device.type == "cpu" else len(whole)
    return torch.cat([_max_blurred(some, sigma, reach) for some in whole.split(block)]).view(maps.shape)


def _max_blurred(maps: Float[Tensor, "n h w"], sigma: float, reach: int) -> Float[Tensor, "n h w"]:
    for dim in (-1, -2):
        size = maps.shape[dim]
        best = maps
        margins = (reach, reach, 0, 0) if dim == -1 else (0, 0, reach, reach)
        wide = F.pad(maps, margins)
        for step in range(1, reach + 1):
            sides = torch.maximum(wide.narrow(dim, reach - step, size), wide.narrow(dim, reach + step, size))
            best = torch.maximum(best, sides * math.exp(-(step**2) / (2 * sigma**2)))
        maps = best
    return maps


def gaussian_blur(
    maps: Float[Tensor, "*b h w"], sigma: float, reach: int, border: Border = "zeros"
) -> Float[Tensor, "*b h w"]:
    """Convolution with a Gaussian cut off ``reach`` pixels from its centre and summing to one.

    >>> gaussian_blur(torch.ones(1, 8, 8), sigma=1.0, reach=2, border="replicate").shape
    torch.Size([1, 8, 8])
    """
    return twice_convolved(padded(require_floating(maps, "maps"), reach, border), gaussian_line(sigma, reach))


def twice_convolved(maps: Float[Tensor, "*b h w"], line: Float[Tensor, "s"]) -> Float[Tensor, "*b H W"]:
    """Convolve maps with a symmetric kernel along both axes, where it lies within them.

    With so few taps, sums of shifted maps are several times faster on a CPU than a convolution of one channel.
    """
    reach = len(line) // 2
    taps = line.tolist()
    for dim in (-1, -2):
        size = maps.shape[dim] - 2 * reach
        total = taps[reach] * maps.narrow(dim, reach, size)
        for step in range(1, reach + 1):
            sides = maps.narrow(dim, reach - step, size) + maps.narrow(dim, reach + step, size)
            total = torch.add(total, sides, alpha=taps[reach + step])
        maps = total
    return maps


def gaussian_line(sigma: float, reach: int) -> Float[Tensor, "s"]:
    """A one-dimensional Gaussian at -reach .. reach, summing to one, in float64."""
    offsets = torch.arange(-reach, reach + 1, dtype=torch.float64)
    line = torch.exp(-(offsets**2) / (2 * sigma**2))
    return line / line.sum()


def _rounded(value: float) -> int:
    return int(value + 0.5)
