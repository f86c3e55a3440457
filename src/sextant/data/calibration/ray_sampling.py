"""How many rays a pixel of a crop averages, and in which level of a panorama's pyramid."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from sextant.data.calibration.pyramids import top_level
from sextant.data.calibration.rays import Rays


@dataclass(frozen=True)
class Sampling:
    """How crops are sampled.

    Attributes:
        level: of the pyramid.
        side: rays along each side of a pixel.
    """

    level: Int64[ndarray, "b"]
    side: Int64[ndarray, "b"]

    @classmethod
    def central(cls, count: int) -> "Sampling":
        """The central ray alone, in the panorama itself."""
        return cls(np.zeros(count, np.int64), np.ones(count, np.int64))

    @classmethod
    def of(cls, rays: Rays, rows: Int64[ndarray, "b"], width: int, height: int) -> "Sampling":
        """Sampling that averages over the area of a crop's pixels, given the ``rows`` of the panoramas.

        The level has at least two of its pixels along a pixel of the crop. Measured against 256 rays per pixel in the
        panorama itself, 3 rays per side err by 0.4 to 1.4 grey levels (root mean square) where one ray errs by 5 to 14;
        2 would err twice as much, and 4 half as much at twice the time.
        """
        # side of a square of the area of the central pixel, in panorama pixels
        size = np.sqrt(4 * rays.lens[:, 0] * rays.lens[:, 1] / (width * height)) * rows / math.pi
        tops = np.array([top_level(int(n)) for n in rows])
        level = np.clip(np.floor(np.log2(np.maximum(size / 2, 1))).astype(np.int64), 0, tops)
        size = size / 2.0**level
        return cls(level, np.select([size <= 0.5, size <= 2], [1, 2], 3).astype(np.int64))
