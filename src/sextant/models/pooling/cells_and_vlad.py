r"""NetVLAD of the whole map joined with means over the cells of a grid: what is seen at all, and what is seen where.

.. math:: \Big[\frac{V}{\lVert V \rVert},\; c\,\frac{\bar x}{\lVert \bar x \rVert}\Big]

with V from :class:`~sextant.models.pooling.NetVLAD` and the map :math:`\bar x` of cell means. The first survives a
change of viewpoint; the second survives a change of season where a camera returns to the same spots.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.layers.cell_means import cell_means
from sextant.models.pooling.netvlad import NetVLAD


class CellsAndVLAD(NetVLAD):
    """NetVLAD and the means over cells, joined; see the module.

    Args:
        channels, size: those of the map; any size is accepted.
        clusters: number of centres, at least 2.
        grid: rows and columns of cells.
        cells: c, the weight of the means.

    Raises:
        UserError: there are fewer than two clusters.
    """

    def __init__(
        self,
        channels: int,
        size: tuple[int, int],
        *,
        clusters: int = 32,
        grid: tuple[int, int] = (4, 6),
        cells: float = 1.0,
    ):
        super().__init__(channels, size, clusters=clusters)
        self.grid, self.cells = (grid[0], grid[1]), cells
        self.features = channels * (clusters + grid[0] * grid[1])

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """NetVLAD of the map, then the weighted means of its cells; both in float32."""
        x = x.to(torch.promote_types(x.dtype, torch.float32))
        means = cell_means(x, self.grid).flatten(1)
        return torch.cat([super().forward(x), self.cells * F.normalize(means, dim=1)], 1)
