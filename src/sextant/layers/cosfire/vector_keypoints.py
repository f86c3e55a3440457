"""Parts that are whole feature vectors of keypoints: strategy B, a reconstruction of chapter 6.

Each part is a 1x1 filter: the direction of the example's feature vector at a place where that vector is long. It
responds where features have the same direction.
"""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.map_keypoints import MapKeypoints
from sextant.layers.cosfire.tuples import Tuples


@dataclass(frozen=True)
class VectorKeypoints(MapKeypoints):
    """Strategy B: local maxima of the length of feature vectors; for a :class:`VectorBank`.

    >>> import torch
    >>> maps = torch.zeros(2, 9, 9)
    >>> maps[:, 4, 7] = torch.tensor([3.0, 4.0])
    >>> parts = VectorKeypoints().tuples(maps, grid=torch.eye(2), point=(4, 4))
    >>> parts.channels, parts.rho  # a vector of length 1, three pixels off
    (tensor([[0.6000, 0.8000]], dtype=torch.float64), tensor([3.], dtype=torch.float64))

    Args:
        arguments: as for :class:`MapKeypoints`.

    Raises:
        ValueError: as for :class:`MapKeypoints`.
    """

    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """Parts at keypoints, their channels vectors of length 1; see :meth:`Strategy.tuples`."""
        length = maps.norm(dim=0)
        _, y, x = self.strongest(length[None], None, point)
        vectors = (maps[:, y, x] / length[y, x]).T.cpu()
        return Tuples.at(vectors, x.cpu() - point[1], y.cpu() - point[0])
