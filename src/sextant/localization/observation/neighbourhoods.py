"""Search for the images of the map near a pose, by the covariance between them."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.observation._cache_kernels import compiled
from sextant.localization.pose_kernel import PoseKernel

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


@dataclass(frozen=True)
class Nearest:
    """The k nearest images of each of n poses, nearest first.

    Attributes:
        rows: rows of the map.
        squared: squared distances in the kernel's features.
    """

    rows: Int64[Tensor, "n k"]
    squared: Float64[Tensor, "n k"]


class Neighbourhoods:
    """Search among the kernel's features of the map's poses, :meth:`PoseKernel.features`, by a k-d tree and a grid.

    Args:
        poses: poses of the map.
        kernel: kernel whose features are compared.
    """

    def __init__(self, poses: Float64[Tensor, "n 3"], kernel: PoseKernel):
        self.kernel = kernel
        self.features = kernel.features(poses).numpy()
        # split in the middle, not at the median: searching is a quarter faster where many headings share a place
        self._tree = cKDTree(self.features, leafsize=16, balanced_tree=False)
        self._grid = PlaceGrid(self.features)

    def __len__(self) -> int:
        return len(self.features)

    def nearest(self, poses: Float64[Tensor, "m 3"]) -> Int64[Tensor, " m"]:
        """The row of the image nearest to each pose; any of those equally near."""
        features = self.kernel.features(poses).numpy()
        rows = self._grid.nearest(features)
        far = np.flatnonzero(rows == NOT_FOUND)
        if len(far):
            rows[far] = self._tree.query(features[far])[1]
        return torch.from_numpy(rows)

    def of_poses(self, poses: Float64[Tensor, "m 3"], k: int) -> Nearest:
        """The k images nearest to each pose."""
        return self._query(self.kernel.features(poses).numpy(), k)

    def of_images(self, rows: Int64[Tensor, " m"], k: int) -> Nearest:
        """The k images nearest to each of these images of the map, itself included."""
        return self._query(self.features[rows.numpy()], k)

    def _query(self, features: np.ndarray, k: int) -> Nearest:
        distances, rows = self._tree.query(features, k=np.arange(1, k + 1))
        return Nearest(torch.from_numpy(rows.astype(np.int64, copy=False)), torch.from_numpy(distances).square_())


def check_neighbours(neighbours: int, images: int) -> None:
    """Raise a UserError unless ``neighbours`` is between 1 and the number of map images."""
    if not 1 <= neighbours <= images:
        raise ArgumentError(
            f"neighbours={neighbours} must be in [1, {images}], the number of images in the map",
            f"Set neighbours={max(1, min(16, images))}, or build a larger map.",
        )
