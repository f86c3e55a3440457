"""An order in which Vecchia's approximation conditions images on earlier ones.

Source: J. Guinness, "Permutation and grouping methods for sharpening Gaussian process approximations", Technometrics
2018: a maximum-minimum-distance order is the most accurate, a random one nearly so, and sorting by a coordinate worse.
"""

import torch
from jaxtyping import Int64
from numpy import ndarray
from torch import Generator


def random_order(images: int, generator: Generator) -> Int64[ndarray, " n"]:
    """A random permutation of the images, in O(n).

    Example:
        >>> order = random_order(5, torch.Generator().manual_seed(0))
        >>> sorted(order.tolist())  # each image once
        [0, 1, 2, 3, 4]
    """
    return torch.randperm(images, generator=generator).numpy()
