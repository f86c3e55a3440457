"""Search for the nearest image of many poses by square cells on the ground, with fewer jumps in memory than a tree."""

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from sextant.localization.observation._cache_kernels import compiled

#: Average number of images in an occupied cell down to which cells are halved.
IMAGES_A_CELL = 16
#: Largest number of cells for each image.
CELLS_AN_IMAGE = 4
#: Rings of cells searched around a pose; poses farther from the map are left to a tree.
RINGS = 6
#: Result for a pose whose nearest image is farther away.
NOT_FOUND = -1


class PlaceGrid:
    """Images sorted by the cell in which they lie; columns 0 and 1 of the features span the ground."""

    def __init__(self, features: Float64[ndarray, "n 4"]):
        self.corner = features[:, :2].min(axis=0)
        extent = features[:, :2].max(axis=0) - self.corner
        self.side, self.shape = _cells(features[:, :2] - self.corner, extent)
        cells = _cell_of(features[:, :2] - self.corner, self.side, self.shape)
        self.rows = np.argsort(cells, kind="stable")
        self.features = features[self.rows]
        counts = np.bincount(cells, minlength=self.shape[0] * self.shape[1])
        self.starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])

    def nearest(self, features: Float64[ndarray, "m 4"]) -> Int64[ndarray, " m"]:
        """The row of the image with the nearest features; ``NOT_FOUND`` far from the map and for nan."""
        found = np.empty(len(features), np.int64)
        search(features, self.corner, self.side, *self.shape, self.starts, self.features, self.rows, found)
        return found


def _cells(places: ndarray, extent: ndarray) -> tuple[float, tuple[int, int]]:
    """Side of the cells, and their number in x and y."""
    side = float(extent.max()) or 1.0
    shape = (1, 1)
    while True:
        finer = (int(extent[0] / (side / 2)) + 1, int(extent[1] / (side / 2)) + 1)
        occupied = len(np.unique(_cell_of(places, side, shape)))
        fine_enough = len(places) <= IMAGES_A_CELL * occupied or finer == (1, 1)  # all in one place
        if fine_enough or finer[0] * finer[1] > CELLS_AN_IMAGE * len(places):
            return side, shape
        side, shape = side / 2, finer


def _cell_of(places: ndarray, side: float, shape: tuple[int, int]) -> ndarray:
    cells = np.minimum((places / side).astype(np.int64), np.array(shape) - 1)
    index: ndarray = cells[:, 1] * shape[0] + cells[:, 0]
    return index


@compiled
def search(queries, corner, side, columns, lines, starts, features, rows, found):  # type: ignore[no-untyped-def]
    """Search the square of 3 by 3 cells, then ring after ring until all that is left is farther than the best."""
    for query in range(len(queries)):
        found[query] = NOT_FOUND
        x, y = (queries[query, 0] - corner[0]) / side, (queries[query, 1] - corner[1]) / side
        inside = -RINGS <= x <= columns + RINGS and -RINGS <= y <= lines + RINGS
        if not inside:  # nan too
            continue
        column, line = int(np.floor(x)), int(np.floor(y))
        best, at = np.inf, NOT_FOUND
        for ring in range(1, RINGS + 1):
            for other in range(max(line - ring, 0), min(line + ring, lines - 1) + 1):
                whole = ring == 1 or other == line - ring or other == line + ring
                step = 1 if whole else 2
                for part in range(step):
                    first = column - ring if part == 0 else column + ring
                    last = column + ring if whole else first
                    first, last = max(first, 0), min(last, columns - 1)
                    if first > last:
                        continue
                    for image in range(starts[other * columns + first], starts[other * columns + last + 1]):
                        a = queries[query, 0] - features[image, 0]
                        b = queries[query, 1] - features[image, 1]
                        c = queries[query, 2] - features[image, 2]
                        d = queries[query, 3] - features[image, 3]
                        square = a * a + b * b + c * c + d * d
                        if square < best:
                            best, at = square, rows[image]
            # the square searched so far extends at least this far from the pose
            reach = side * (ring + min(x - column, column + 1 - x, y - line, line + 1 - y))
            if best <= reach * reach:
                found[query] = at
                break
