"""Parts where single channels of a feature map peak: strategy A, a reconstruction of chapter 6.

The paper says that contributing filters are defined by intermediate representations of a network. In this reading, its
channels play the part that Gabor filters play in the first COSFIRE.
"""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.map_keypoints import MapKeypoints
from sextant.layers.cosfire.tuples import Tuples


@dataclass(frozen=True)
class ChannelPeaks(MapKeypoints):
    """Strategy A: local maxima of each channel.

    >>> import torch
    >>> maps = torch.zeros(2, 9, 9)
    >>> maps[0, 2, 6] = maps[1, 2, 4] = 1.0  # up to the right of the point, and above it
    >>> parts = ChannelPeaks().tuples(maps, grid=torch.tensor([[0.0], [1.0]]), point=(4, 4))
    >>> parts.channels[:, 0].tolist(), parts.rho.round(decimals=2).tolist(), parts.phi.rad2deg().round().tolist()
    ([0.0, 1.0], [2.83, 2.0], [45.0, 90.0])

    Args:
        t2: a channel is kept if it reaches this share of the strongest channel at its place.
        other arguments: as for :class:`MapKeypoints`.

    Raises:
        ValueError: as for :class:`MapKeypoints`, or ``t2`` is outside [0, 1].
    """

    t2: float = 0.75

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.t2 <= 1:
            raise ValueError(f"channel peaks need t2 in [0, 1], got {self.t2}")

    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """Parts at peaks; see :meth:`Strategy.tuples`."""
        k, y, x = (found.cpu() for found in self.strongest(maps, maps >= self.t2 * maps.amax(0), point))
        return Tuples.at(grid[k], x - point[1], y - point[0])
