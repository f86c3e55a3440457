"""Street lamps as point lights, with a grid to look up the nearest."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int32
from numpy import ndarray
from scipy.spatial import cKDTree

#: side of a grid cell in metres, lamps kept per cell, and how far a lamp reaches
CELL_M, NEAREST, REACH_M = 8.0, 3, 32.0


@dataclass(frozen=True)
class Lamps:
    """Point lights.

    Attributes:
        position: metres.
        cells: the lamps nearest to each grid cell; -1 where there is none.
        origin: x and y of the grid's corner, and side of a cell.
    """

    position: Float64[ndarray, "n 3"]
    cells: Int32[ndarray, "gx gy 3"]
    origin: Float64[ndarray, "3"]

    @classmethod
    def at(cls, position: Float64[ndarray, "n 3"]) -> "Lamps":
        """Lamps at the given positions."""
        if len(position) == 0:
            return cls(np.zeros((0, 3)), np.full((1, 1, NEAREST), -1, np.int32), np.array([0.0, 0.0, CELL_M]))
        low = position[:, :2].min(0) - REACH_M
        shape = np.ceil((position[:, :2].max(0) + REACH_M - low) / CELL_M).astype(int)
        centres = low + (np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1) + 0.5) * CELL_M
        _, nearest = cKDTree(position[:, :2]).query(centres, k=NEAREST, distance_upper_bound=REACH_M)
        cells = np.where(nearest == len(position), -1, nearest).astype(np.int32)
        return cls(np.ascontiguousarray(position, np.float64), np.ascontiguousarray(cells), np.array([*low, CELL_M]))
