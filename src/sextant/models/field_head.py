"""From a feature map to the perspective field of its cells."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from sextant.geometry.field_fit import BelievedField
from sextant.geometry.perspective_field import PerspectiveField

WIDTH = 128
#: ends of the logarithm of an expected error: 0.4 degrees and more than any
LOG_ERROR = (-5.0, 1.5)
#: ends of the logarithm of the trust in the first answer, and what it is before training
LOG_TRUST, FIRST_LOG_TRUST = (-3.0, 5.0), 2.0
#: sides of the canvas by which a cell's centre may lie outside the picture, which the cell then overlaps
OVERLAP = 0.01


class FieldHead(nn.Module):
    """Predicts a latitude and an up direction for each cell of a map, from the cell and the whole picture.

    Args:
        channels: of the map.
        cells: rows and columns of the map.
        features: length of the vector that stands for the whole picture.

    Example:
        >>> believed = FieldHead(8, (7, 7), 16)(torch.rand(2, 8, 7, 7), torch.rand(2, 16))
        >>> believed.field.latitude.shape, believed.field.up.shape, believed.log_error.shape, believed.trust.shape
        (torch.Size([2, 49]), torch.Size([2, 49, 2]), torch.Size([2, 2, 49]), torch.Size([2, 4]))
    """

    def __init__(self, channels: int, cells: tuple[int, int], features: int):
        super().__init__()
        self.cells = cells
        self.cell = nn.Conv2d(channels, WIDTH, 1)
        self.context = nn.Linear(features, WIDTH)
        self.place = nn.Parameter(torch.zeros(1, WIDTH, *cells))
        self.mix = nn.Conv2d(WIDTH, WIDTH, 3, padding=1)
        self.out = nn.Conv2d(WIDTH, 5, 1)
        self.trust = nn.Linear(features, 4)
        nn.init.zeros_(self.trust.weight)
        nn.init.constant_(self.trust.bias, FIRST_LOG_TRUST)

    def forward(self, cells: Float[Tensor, "b c h w"], features: Float[Tensor, "b f"]) -> BelievedField:
        """The field of each map's cells, row by row, in single precision."""
        hidden = F.relu(self.cell(cells) + self.context(features)[..., None, None] + self.place)
        hidden = F.relu(hidden + self.mix(hidden))
        said = self.out(hidden).float().flatten(2)
        up = F.normalize(said[:, :2].mT + said.new_tensor([0.0, -1.0]), dim=-1, eps=1e-6)
        trust = torch.exp(self.trust(features).float().clamp(*LOG_TRUST))
        return BelievedField(PerspectiveField(said[:, 2], up), said[:, 3:].clamp(*LOG_ERROR), trust)


def cell_centres(
    cells: tuple[int, int], aspect: Float[Tensor, "b"]
) -> tuple[Float[Tensor, "b n 2"], Bool[Tensor, "b n"]]:
    """Centres of the cells of a square canvas, in its sides from the middle, and which show pictures of an aspect.

    >>> points, seen = cell_centres((2, 3), torch.tensor([0.5]))
    >>> points[0, :3, 0], seen[0]
    (tensor([-0.3333,  0.0000,  0.3333]), tensor([False,  True, False, False,  True, False]))
    """
    down, across = ((torch.arange(n, dtype=aspect.dtype, device=aspect.device) + 0.5) / n - 0.5 for n in cells)
    rows, columns = torch.meshgrid(down, across, indexing="ij")
    points = torch.stack([columns, rows], -1).reshape(1, -1, 2).expand(len(aspect), -1, -1)
    half = torch.stack([aspect.clamp(max=1), 1 / aspect.clamp(min=1)], -1)[:, None] / 2
    return points, (points.abs() <= half + OVERLAP).all(-1)
