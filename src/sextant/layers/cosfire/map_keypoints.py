"""What strategies have in common that look for the strongest places of a feature map, whatever the shape they form."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from sextant.layers.cosfire.strategy import Strategy, keep_apart, near, peaks


@dataclass(frozen=True)
class MapKeypoints(Strategy):
    """Parts at keypoints of maps; says which places, not which channels.

    Args:
        window: a keypoint is the largest of a square of 2 window + 1 pixels of its map; 0: anything strong enough.
        reach: parts lie within this many pixels of the point.
        strength: keypoints have this share of the example's strongest at least.
        apart: places of parts are at least so many pixels apart; at one place there may be several.
        most: parts, the strongest.

    Raises:
        ValueError: a share outside [0, 1], a negative window, or no part.
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
        """Map, row and column of the keypoints about ``point``, the strongest first; ``among`` None is anywhere."""
        found = peaks(strength, self.window) & near(strength, point, self.reach)
        found &= strength >= self.strength * strength.max()
        k, y, x = (found if among is None else found & among).nonzero(as_tuple=True)
        kept = torch.tensor(keep_apart(strength[k, y, x], y, x, self.apart, self.most), dtype=torch.int64)
        return k[kept], y[kept], x[kept]
