r"""Positions on the ellipsoid WGS 84 in metres.

A position of latitude φ, longitude λ and height h has, with :math:`N = a / \sqrt{1 - e^2 \sin^2\varphi}`, the
geocentric coordinates

.. math:: ((N + h)\cos\varphi\cos\lambda,\; (N + h)\cos\varphi\sin\lambda,\; (N (1 - e^2) + h)\sin\varphi).

Source: NIMA TR8350.2, "World Geodetic System 1984".
"""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

#: semi-major axis in metres, and the square of the first eccentricity
SEMI_MAJOR_M, ECCENTRICITY_2 = 6378137.0, 6.69437999014e-3


def geocentric(
    latitude: Float64[ndarray, "n"], longitude: Float64[ndarray, "n"], height_m: Float64[ndarray, "n"] | float = 0.0
) -> Float64[ndarray, "n 3"]:
    """Positions in metres from the centre of the earth; angles in radians.

    Example:
        >>> geocentric(np.zeros(1), np.zeros(1)).tolist()
        [[6378137.0, 0.0, 0.0]]
    """
    sine, cosine = np.sin(latitude), np.cos(latitude)
    normal = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_2 * sine**2)
    level, upright = (normal + height_m) * cosine, (normal * (1 - ECCENTRICITY_2) + height_m) * sine
    return np.stack([level * np.cos(longitude), level * np.sin(longitude), upright], axis=-1)


def local_axes(latitude: Float64[ndarray, "n"], longitude: Float64[ndarray, "n"]) -> Float64[ndarray, "n 3 3"]:
    """East, north and up at places, as rows in geocentric coordinates; angles in radians.

    Example:
        >>> local_axes(np.zeros(1), np.zeros(1))[0].tolist()  # on the equator, up is geocentric x
        [[-0.0, 1.0, 0.0], [-0.0, -0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    sp, cp, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    rows = [-sl, cl, 0 * cl, -sp * cl, -sp * sl, cp, cp * cl, cp * sl, sp]
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)
