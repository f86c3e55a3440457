r"""The pinhole camera of correspondences, its projection with derivatives, and the geometry of two of them.

A point :math:`X = (X, Y, Z)` of the camera (x right, y down, z forward) has the pixel

.. math:: u = f_x X / Z + c_x, \qquad v = f_y Y / Z + c_y .
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.errors import ArgumentError
from sextant.ranges import Count, Positive, checked


@checked
@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion.

    Attributes:
        width, height: of the image, pixels.
        fx, fy: focal lengths, pixels.
        cx, cy: principal point, pixels; (0, 0) is the centre of the first pixel.

    Raises:
        ArgumentError: a size or focal length is not above 0, or a number is not finite.

    Example:
        >>> Pinhole.centred(640, 480, 500.0).rays(np.array([[319.5, 239.5]]))
        array([[0., 0., 1.]])
    """

    width: Count
    height: Count
    fx: Positive
    fy: Positive
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if not np.isfinite([self.cx, self.cy]).all():
            raise ArgumentError(f"the principal point ({self.cx}, {self.cy}) must be finite", of=self)

    @classmethod
    def centred(cls, width: int, height: int, focal_px: float) -> "Pinhole":
        """A camera of square pixels whose principal point is the centre of the image."""
        return cls(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)

    def of_focal_length(self, focal_px: float) -> "Pinhole":
        """The same camera with another focal length ``fx``, and ``fy`` in proportion."""
        return Pinhole(self.width, self.height, focal_px, focal_px * self.fy / self.fx, self.cx, self.cy)

    def rays(self, pixels: Float64[ndarray, "n 2"]) -> Float64[ndarray, "n 3"]:
        """Directions of pixels, with z = 1."""
        x = (pixels[:, 0] - self.cx) / self.fx
        return np.column_stack([x, (pixels[:, 1] - self.cy) / self.fy, np.ones(len(pixels))])

    def project(self, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 2"]:
        """Pixels of points of the camera; nan behind it."""
        z = np.where(points[:, 2] > 0, points[:, 2], np.nan)
        return np.column_stack([self.fx * points[:, 0] / z + self.cx, self.fy * points[:, 1] / z + self.cy])

    def jacobian(self, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 2 3"]:
        """Derivatives of the pixels by the points of the camera."""
        x, y, z = points.T
        zero = np.zeros_like(z)
        u = np.column_stack([self.fx / z, zero, -self.fx * x / z**2])
        v = np.column_stack([zero, self.fy / z, -self.fy * y / z**2])
        return np.stack([u, v], 1)

    def poselib(self) -> dict[str, Any]:
        """The camera in the notation of poselib."""
        params = [self.fx, self.fy, self.cx, self.cy]
        return {"model": "PINHOLE", "width": self.width, "height": self.height, "params": params}


def cross_matrices(vectors: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3 3"]:
    """The matrices :math:`[x]_\\times` with :math:`[x]_\\times y = x \\times y`."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([np.stack([zero, -z, y], 1), np.stack([z, zero, -x], 1), np.stack([-y, x, zero], 1)], 1)


def sampson_errors(
    first: Float64[ndarray, "n 2"], second: Float64[ndarray, "n 2"], essential: Float64[ndarray, "3 3"]
) -> Float64[ndarray, "n"]:
    r"""First-order distances from the epipolar constraint, signed:
    :math:`x_2^\top E x_1 / \sqrt{(E x_1)_1^2 + (E x_1)_2^2 + (E^\top x_2)_1^2 + (E^\top x_2)_2^2}`."""
    one, two = (np.column_stack([each, np.ones(len(each))]) for each in (first, second))
    lines, back = one @ essential.T, two @ essential
    length = np.sqrt((lines[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1)).clip(min=1e-12)
    return np.asarray(np.einsum("ni,ni->n", two, lines) / length)
