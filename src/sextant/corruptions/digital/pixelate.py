r"""Loss of resolution, with Pillow's arithmetic to the last bit.

With a box filter, Pillow resizes one axis after the other, columns first. A pass takes weights as integers in units of
:math:`2^{-22}`, adds, and rounds to 8 bits: :math:`y_i = \lfloor (Σ_j W_{ij} x_j + 2^{21}) / 2^{22} \rfloor`. The sums
are whole numbers that fit into float64, and into float32 where every mean is of one, two or four pixels, so matrix
products give the same bytes for a whole batch, on any device.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption

PILLOW_UNIT = 2**22


@lru_cache(maxsize=64)
def box_weights(before: int, after: int) -> tuple[Tensor, int]:
    """The integer weights ``(after, before)`` of a pass from ``before`` pixels to ``after``, and their unit.

    Weights and unit are divided by their common factor; the type is the smallest that holds all sums.
    """
    scale = before / after
    half = 0.5 * max(scale, 1.0)
    weights = torch.zeros(after, before, dtype=torch.int64)
    for i in range(after):
        centre = (i + 0.5) * scale
        first, last = max(int(centre - half + 0.5), 0), min(int(centre + half + 0.5), before)
        taken = [j for j in range(first, last) if -0.5 < (j - centre + 0.5) / max(scale, 1.0) <= 0.5]
        weights[i, taken] = math.floor(0.5 + PILLOW_UNIT / len(taken))
    common = math.gcd(PILLOW_UNIT, *weights.unique().tolist())
    unit = PILLOW_UNIT // common
    return (weights // common).to(torch.float32 if 256 * unit <= 2**24 else torch.float64), unit


def box_resize(pixels: Float[Tensor, "b c h w"], height: int, width: int) -> Float[Tensor, "b c p q"]:
    """Whole values 0 ... 255, resized as ``PIL.Image.resize((width, height), BOX)`` does.

    Example:
        >>> box_resize(torch.tensor([[[[0.0, 10.0, 100.0, 101.0]] * 2]]), 1, 2)  # means of 2x2 pixels; 100.5 goes up
        tensor([[[[  5., 101.]]]])
    """
    if width != pixels.shape[-1]:
        weights, unit = _weights_for(pixels, pixels.shape[-1], width)
        pixels = _rounded(pixels.to(weights) @ weights.T, unit)
    if height != pixels.shape[-2]:
        weights, unit = _weights_for(pixels, pixels.shape[-2], height)
        pixels = _rounded(weights @ pixels.to(weights), unit)
    return pixels


def _weights_for(pixels: Tensor, before: int, after: int) -> tuple[Tensor, int]:
    weights, unit = box_weights(before, after)
    # a GPU may be told to multiply float32 with 11 bits (TF32)
    return (weights if pixels.device.type == "cpu" else weights.to(pixels.device, torch.float64)), unit


def _rounded(sums: Float[Tensor, "*n"], unit: int) -> Float[Tensor, "*n"]:
    # the weights of a mean of three are rounded and may sum to more than the unit, but never to half a grey level more
    return sums if unit == 1 else sums.mul_(1 / unit).add_(0.5).floor_()


@dataclass(frozen=True)
class Pixelate(BenchmarkCorruption[float, None]):
    """Down to ``⌊f n⌋`` pixels per axis and back up to n, by box filter.

    Source: Hendrycks & Dietterich, ICLR 2019, with Pillow.

    >>> image = torch.tensor([[[[0.0, 0.4, 1.0, 0.6]] * 2]])
    >>> Pixelate((0.5,), "pixelate")(image, level=1, indices=[0], seed=0)[0, 0, 0]  # blocks of two by two
    tensor([0.2000, 0.2000, 0.8000, 0.8000])

    Args:
        table: f for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Resize down and up; images are rounded to 8 bits first."""
        height, width = images.shape[-2:]
        factor = self.row(level)
        pixels = (images.float() * 255).round_().clamp_(0, 255)
        small = box_resize(pixels, max(int(height * factor), 1), max(int(width * factor), 1))
        return (box_resize(small, height, width).float() / 255).to(images.dtype)
