"""Neighbours of the images of one tile of a map, found in that tile and a halo around it, not in the whole map."""

import numpy as np
import torch
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.localization.observation.neighbourhoods import Neighbourhoods
from sextant.localization.pose_kernel import PoseKernel

#: margin for the rounding of distances, both relative and absolute
SLACK = 1e-9


class Tiles:
    """Runs of consecutive images of a map, and the box of each on the ground in lengths of the kernel.

    Args:
        poses: poses of the map, best in spatial order; may be a mapped file.
        kernel: kernel whose features are compared.
        size: number of images in a tile; a last tile with fewer than ``least`` is merged into the one before.
        least: smallest number of images in a tile.
    """

    def __init__(self, poses: Float64[Tensor, "n 3"], kernel: PoseKernel, size: int, least: int):
        self.poses, self.kernel = poses, kernel
        count = max(1, len(poses) // size + (len(poses) % size >= least))
        self.ends = np.append(np.arange(count) * size, len(poses))
        boxes = [self._ground(start, stop) for start, stop in zip(self.ends[:-1], self.ends[1:], strict=True)]
        self._low = np.stack([ground.min(axis=0) for ground in boxes])
        self._high = np.stack([ground.max(axis=0) for ground in boxes])

    def __len__(self) -> int:
        return len(self.ends) - 1

    def rows(self, tile: int) -> Int64[Tensor, " m"]:
        """The images of a tile."""
        return torch.arange(int(self.ends[tile]), int(self.ends[tile + 1]))

    def neighbours(self, tile: int, k: int) -> Int64[Tensor, "m k"]:
        """The k nearest images of the whole map to each image of a tile, nearest first.

        The k nearest within the tile bound the distance of the k nearest of all. The halo is as wide as the widest of
        these bounds, so that nothing beyond it can be nearer.
        """
        own = self.rows(tile)
        features = self.kernel.features(self.poses[own]).numpy()
        bounds = cKDTree(features).query(features, k=[k])[0]
        reach = float(bounds.max()) * (1 + SLACK) + SLACK
        low, high = self._low[tile] - reach, self._high[tile] + reach
        near = np.flatnonzero(((self._low <= high) & (self._high >= low)).all(axis=1))
        candidates = torch.cat([self._within(int(other), low, high) for other in near])
        search = Neighbourhoods(self.poses[candidates], self.kernel)
        return candidates[search.of_images(torch.searchsorted(candidates, own), k).rows]

    def _within(self, tile: int, low: ndarray, high: ndarray) -> Tensor:
        start, stop = int(self.ends[tile]), int(self.ends[tile + 1])
        ground = self._ground(start, stop)
        return start + torch.from_numpy(np.flatnonzero(((ground >= low) & (ground <= high)).all(axis=1)))

    def _ground(self, start: int, stop: int) -> ndarray:
        ground: ndarray = self.kernel.features(self.poses[start:stop])[:, :2].numpy()
        return ground
