r"""Orders in which Vecchia's approximation conditions images on earlier ones.

Source: J. Guinness, "Permutation and grouping methods for sharpening Gaussian process approximations", Technometrics
2018: maximum-minimum-distance order is the most accurate, a random one nearly so, that of a coordinate worse.
"""

import numpy as np
import torch
from jaxtyping import Float64, Int64
from numpy import ndarray
from torch import Generator


def random_order(images: int, generator: Generator) -> Int64[ndarray, " n"]:
    """A random permutation of the images: O(n)."""
    return torch.randperm(images, generator=generator).numpy()


def maxmin_order(features: Float64[ndarray, "n f"]) -> Int64[ndarray, " n"]:
    """The image nearest the centre, then always the one whose nearest chosen image is farthest: O(n² f) time.

    Of images equally far the first is taken. Meant for up to about 10,000 images.
    """
    order = np.empty(len(features), dtype=np.int64)
    order[0] = np.square(features - features.mean(0)).sum(1).argmin()
    gap = np.full(len(features), np.inf)
    for place in range(1, len(features)):
        gap = np.minimum(gap, np.square(features - features[order[place - 1]]).sum(1))
        gap[order[place - 1]] = -np.inf  # chosen, also if others stand on the same pose
        order[place] = gap.argmax()
    return order
