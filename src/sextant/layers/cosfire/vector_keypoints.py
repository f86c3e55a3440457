"""Parts that are whole feature vectors of keypoints: strategy B, a reconstruction of chapter 6.

Each part is a 1x1 filter: the direction of the example's feature vector at a place where it is long. It answers where
features have the same direction.
"""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.strategy import Strategy, keep_apart, near, peaks
from sextant.layers.cosfire.tuples import Tuples


@dataclass(frozen=True)
class VectorKeypoints(Strategy):
    """Strategy B: local maxima of the length of feature vectors; for a :class:`VectorBank`.

    Args:
        window: a keypoint is the largest of a square of 2 window + 1 pixels; 0: anything strong enough.
        reach: parts lie within this many pixels of the point.
        strength: keypoints have this share of the length of the longest at least.
        apart: parts are at least so many pixels apart.
        most: parts, the strongest.

    Raises:
        ValueError: a share outside [0, 1], or a size that is not positive.
    """

    window: int = 1
    reach: float = 8.0
    strength: float = 0.2
    apart: float = 1.0
    most: int = 20

    def __post_init__(self) -> None:
        if not (0 <= self.strength <= 1 and self.window >= 0 and self.most >= 1):
            raise ValueError(f"vector keypoints need strength in [0, 1], window >= 0 and most >= 1; got {self}")

    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """Parts at keypoints, their channels vectors of length 1; see :meth:`Strategy.tuples`."""
        length = maps.norm(dim=0)
        enough = length >= self.strength * length.max()
        y, x = (peaks(length[None], self.window)[0] & enough & near(maps, point, self.reach)).nonzero(as_tuple=True)
        kept = keep_apart(length[y, x], y, x, self.apart, self.most)
        y, x = y[kept], x[kept]
        vectors = (maps[:, y, x] / length[y, x]).T.cpu()
        return Tuples.at(vectors, x.cpu() - point[1], y.cpu() - point[0])
