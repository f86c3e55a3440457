"""How far apart the images of a map are, and how much their descriptors vary."""

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

#: Positions closer than this share of the map's extent are one position.
SAME = 1e-9
#: Descriptors that are processed together.
BLOCK = 16_384


def nearest_distance(positions: Float64[ndarray, "n 2"]) -> float:
    """The median distance from a position to the nearest other one; 1 if there is no other.

    Images at one position count once. Otherwise a map of panoramas cut into views would have distance zero.
    """
    extent = float(np.ptp(positions, axis=0).max())
    if extent == 0:
        return 1.0
    grain = SAME * extent
    cells = np.round((positions - positions.min(0)) / grain).astype(np.int64)
    # one number for both coordinates: each is at most 1e9, so the pair fits in 63 bits
    places = np.unique(cells[:, 0] * (round(1 / SAME) + 1) + cells[:, 1])
    points = grain * np.column_stack(np.divmod(places, round(1 / SAME) + 1)).astype(np.float64)
    distances, _ = cKDTree(points).query(points, k=2)
    return float(np.median(distances[:, 1]))


def mean_variance(descriptors: Float[Tensor, "n d"]) -> float:
    """The variance of descriptor values about their means, averaged over dimensions and computed in blocks."""
    blocks = descriptors.split(BLOCK)
    mean = sum(rows.double().sum(0) for rows in blocks) / len(descriptors)
    squares = [float((rows.double() - mean).square().sum()) for rows in blocks]
    return sum(squares) / descriptors.numel()
