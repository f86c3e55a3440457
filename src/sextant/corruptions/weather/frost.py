"""Frost: ice on the glass in front of the camera."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.luma import luma
from sextant.corruptions.weather.frost_textures import HEIGHT, KINDS, WIDTH, frost_texture


class FrostDraw(NamedTuple):
    """The texture that each image gets, and the corner of its crop."""

    kinds: Int64[Tensor, "b"]
    tops: Int64[Tensor, "b"]
    lefts: Int64[Tensor, "b"]


@dataclass(frozen=True)
class Frost(BenchmarkCorruption[tuple[float, float], FrostDraw]):
    """``y = a·x + b·frost``, clipped to [0, 1], with a random crop of one of five textures of ice.

    The textures are drawn here (:mod:`sextant.corruptions.weather.frost_textures`), because the authors' photographs
    may not be redistributed. So an error under frost is *not comparable* with one on the published files. Images of one
    channel get the luma of the frost.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> drawn = Frost(((0.8, 0.4),), "frost", shrink=0.2).draw(1, torch.arange(100), (3, 32, 32), seed=0)
    >>> drawn.kinds.unique(), drawn.tops.max() <= 154 - 32  # cut-outs of 154x205 pixels
    (tensor([0, 1, 2, 3, 4]), tensor(True))

    Args:
        table: (a, b) for each severity.
        shrink: size of the textures, 1 for 768x1024 pixels as for ImageNet-C; CIFAR-10-C has 0.2, bilinear without
            smoothing. Textures are enlarged where needed to exceed the image by one pixel.
    """

    shrink: float = 1.0

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> FrostDraw:
        """Texture and place, each equally likely."""
        height, width = shape[-2:]
        full_height, full_width = self._size(height, width)
        draws = [
            [
                int(torch.randint(limit, (), generator=stream))
                for limit in (len(KINDS), full_height - height, full_width - width)
            ]
            for stream in self.streams(level, indices, seed)
        ]
        return FrostDraw(*torch.tensor(draws, dtype=torch.int64).reshape(-1, 3).unbind(-1))

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: FrostDraw) -> Float[Tensor, "b c h w"]:
        """Lay the drawn frost over the images."""
        share, strength = self.row(level)
        height, width = images.shape[-2:]
        size = self._size(height, width)
        places = zip(*(part.tolist() for part in params), strict=True)
        frost = [_texture(kind, *size)[:, top : top + height, left : left + width] for kind, top, left in places]
        ice = torch.stack(frost).to(images)
        return (share * images + strength * (luma(ice) if images.shape[1] == 1 else ice)).clamp(0, 1)

    def _size(self, height: int, width: int) -> tuple[int, int]:
        """Height and width of the textures for images of ``height`` and ``width``."""
        factor = max(self.shrink, (height + 1) / HEIGHT, (width + 1) / WIDTH)
        return max(round(HEIGHT * factor), height + 1), max(round(WIDTH * factor), width + 1)


@lru_cache(maxsize=2 * len(KINDS))
def _texture(kind: int, height: int, width: int) -> Float[Tensor, "3 h w"]:
    resized = cv2.resize(frost_texture(kind), (width, height), interpolation=cv2.INTER_LINEAR)
    return torch.from_numpy(np.ascontiguousarray(resized.transpose(2, 0, 1)))
