"""The base of strategies that look for the strongest places of a feature map, whatever shape they form."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from sextant.layers.cosfire.strategy import Strategy, keep_apart, near, peaks


@dataclass(frozen=True)
class MapKeypoints(Strategy):
    """Parts at keypoints of maps; decides the places, not the channels.

    Args:
        window: a keypoint is the maximum of a square of 2 window + 1 pixels of its map; 0: any pixel strong enough.
        reach: parts lie within this many pixels of the point.
        strength: keypoints have at least this share of the example's strongest.
        apart: least distance between the places of parts, in pixels; several parts may share a place.
        most: largest number of parts; the strongest are kept.

    Raises:
        ValueError: ``strength`` is outside [0, 1], ``window`` is negative, or ``most`` is below 1.
    """

    window: int = 1
    reach: float = 8.0
    strength: float = 0.2
    apart: float = 1.0
    most: int = 20

    def __post_init__(self) -> None:
        if not (0 <= self.strength <= 1 and self.window >= 0 and self.most >= 1):
            raise ValueError(f"keypoints need strength in [0, 1], window >= 0 and most >= 1; got {self}")

    def strongest(
        self, strength: Float[Tensor, "k y x"], among: Bool[Tensor, "k y x"] | None, point: tuple[int, int]
    ) -> tuple[Int64[Tensor, "n"], Int64[Tensor, "n"], Int64[Tensor, "n"]]:
        """Map, row and column of the keypoints around ``point``, strongest first; ``among`` None allows any pixel."""
        found = peaks(strength, self.window) & near(strength, point, self.reach)
        found &= strength >= self.strength * strength.max()
        k, y, x = (found if among is None else found & among).nonzero(as_tuple=True)
        kept = torch.tensor(keep_apart(strength[k, y, x], y, x, self.apart, self.most), dtype=torch.int64)
        return k[kept], y[kept], x[kept]
