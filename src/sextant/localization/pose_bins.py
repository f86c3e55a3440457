"""A grid of boxes over the plane and the circle of headings, to count and group poses."""

import math
from dataclasses import dataclass

from jaxtyping import Float64, Int64
from torch import Tensor


@dataclass(frozen=True)
class PoseBins:
    """Boxes of a grid in x, y and heading.

    Attributes:
        position: side of a box in metres.
        heading: desired width in rad; the width used divides the circle into whole boxes, at least one.

    Example:
        >>> import torch
        >>> bins = PoseBins(position=1.0, heading=math.radians(90))
        >>> poses = torch.tensor([[[0.2, 0.5, 0.1], [0.7, 0.1, 0.1 + 2 * math.pi], [-0.1, 0.5, 0.1]]]).double()
        >>> bins.cells(poses).tolist(), bins.occupied(poses).tolist()  # headings a turn apart are the same
        ([[[0, 0, 0], [0, 0, 0], [-1, 0, 0]]], [2])
    """

    position: float
    heading: float

    @property
    def turns(self) -> int:
        """The number of boxes around the circle."""
        return max(1, round(2 * math.pi / self.heading))

    def cells(self, poses: Float64[Tensor, "r p 3"]) -> Int64[Tensor, "r p 3"]:
        """The box of each pose: column, row, and heading from 0 to ``turns - 1``."""
        scale = poses.new_tensor([1 / self.position, 1 / self.position, self.turns / (2 * math.pi)])
        cells = (poses * scale).floor().long()
        cells[..., 2].remainder_(self.turns)
        return cells

    def keys(self, cells: Int64[Tensor, "r p 3"]) -> Int64[Tensor, "r p"]:
        """One number for each box, the same in all runs."""
        column, row, heading = (cells - cells.amin((0, 1))).unbind(2)
        return (column * (row.max() + 1) + row) * self.turns + heading

    def occupied(self, poses: Float64[Tensor, "r p 3"]) -> Int64[Tensor, "r"]:
        """How many boxes the poses of each run lie in."""
        ordered = self.keys(self.cells(poses)).sort(1).values
        return 1 + (ordered[:, 1:] != ordered[:, :-1]).sum(1)
