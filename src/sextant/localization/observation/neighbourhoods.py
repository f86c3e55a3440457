"""Search for the images of the map near a pose, by the covariance between them."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64, Int64
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.observation._place_grid import NOT_FOUND, PlaceGrid
from sextant.localization.pose_kernel import PoseKernel


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
