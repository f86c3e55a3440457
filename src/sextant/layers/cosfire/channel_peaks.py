"""Parts where single channels of a feature map peak: strategy A, a reconstruction of chapter 6.

The paper says that contributing filters are defined by intermediate representations of a network; this reading takes
its channels for what Gabor filters are to the first COSFIRE.
"""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.strategy import Strategy, keep_apart, near, peaks
from sextant.layers.cosfire.tuples import Tuples


@dataclass(frozen=True)
class ChannelPeaks(Strategy):
    """Strategy A: local maxima of each channel.

    Args:
        window: a peak is the largest of a square of 2 window + 1 pixels of its map; 0: anything strong enough.
        reach: parts lie within this many pixels of the point.
        t2: a channel is kept from this share of the strongest channel at its place on.
        strength: and from this share of the strongest response of the example on.
        apart: parts are at least so many pixels apart.
        most: parts, the strongest.

    Raises:
        ValueError: a share outside [0, 1], or a size that is not positive.
    """

    window: int = 1
    reach: float = 8.0
    t2: float = 0.75
    strength: float = 0.2
    apart: float = 1.0
    most: int = 20

    def __post_init__(self) -> None:
        if not (0 <= self.t2 <= 1 and 0 <= self.strength <= 1 and self.window >= 0 and self.most >= 1):
            raise ValueError(f"channel peaks need t2 and strength in [0, 1], window >= 0 and most >= 1; got {self}")

    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """Parts at peaks; see :meth:`Strategy.tuples`."""
        enough = (maps >= self.strength * maps.max()) & (maps >= self.t2 * maps.amax(0))
        k, y, x = (peaks(maps, self.window) & enough & near(maps, point, self.reach)).nonzero(as_tuple=True)
        kept = keep_apart(maps[k, y, x], y, x, self.apart, self.most)
        k, y, x = k[kept].cpu(), y[kept].cpu(), x[kept].cpu()
        return Tuples.at(grid[k], x - point[1], y - point[0])
