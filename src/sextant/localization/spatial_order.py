"""Spatial order: an order of places in which neighbours on the ground are neighbours in a file."""

import numpy as np
import torch
from jaxtyping import Float64, Int64
from torch import Tensor

#: Bits for the cells along the longer side of the map: cells of 1 mm in a map of 2,000 km.
BITS = 31


def spatial_order(poses: Float64[Tensor, "n 3"]) -> Int64[Tensor, " n"]:
    """Rows in Morton order (the Z-order curve) of their square cells on the ground; within a cell, by heading.

    A map stored in this order, as ``poses[rows]`` and ``descriptors[rows]``, is read in few pages when it is larger
    than memory and mapped, because images near each other are stored near each other.

    Raises:
        ValueError: a pose is not finite.

    Source: G. M. Morton, "A computer oriented geodetic data base and a new technique in file sequencing", IBM 1966.

    Example:
        >>> corners = torch.tensor([[0.0, 0, 0], [9, 9, 0], [9, 0, 0], [0, 9, 0]], dtype=torch.float64)
        >>> corners[spatial_order(corners)][:, :2].tolist()  # a Z
        [[0.0, 0.0], [9.0, 0.0], [0.0, 9.0], [9.0, 9.0]]
    """
    places = poses.numpy()
    if not np.isfinite(places).all():
        raise ValueError("a pose is not finite")
    if len(places) == 0:
        return torch.zeros(0, dtype=torch.int64)
    corner = places[:, :2].min(axis=0)
    side = float((places[:, :2].max(axis=0) - corner).max()) or 1.0
    cells = ((places[:, :2] - corner) / side * (2**BITS - 1)).astype(np.uint64)
    codes = _spread(cells[:, 0]) | (_spread(cells[:, 1]) << np.uint64(1))
    return torch.from_numpy(np.lexsort((places[:, 2], codes)))


def _spread(values: np.ndarray) -> np.ndarray:
    """Spread the 32 bits of every value over the even bits of 64."""
    for shift, mask in (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ):
        values = (values | (values << np.uint64(shift))) & np.uint64(mask)
    return values
