r"""Undistortion: the photo that a lens without distortion would have taken.

Undistortion needs no inversion: a pixel at the normalised point p of the undistorted picture is seen at
:math:`f (1 + k_1 |p|^2 + k_2 |p|^4) p` from the centre of the photo.
"""

import math
from typing import Literal

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray

from sextant.geometry import max_radius, undistort_radius

STRIP = 256  # rows undistorted at a time
Keep = Literal["crop", "all"]


def undistort_photo(
    image: UInt8[ndarray, "h w 3"], focal: float, k1: float, k2: float, keep: Keep = "crop"
) -> tuple[UInt8[ndarray, "h w 3"], float]:
    """Undistort a photo, at the same size; also returns the focal length of the result in pixels.

    Args:
        image: the photo.
        focal: its focal length in pixels of ``image``.
        k1: first coefficient of its distortion.
        k2: second coefficient.
        keep: ``crop`` crops so that no empty border is left; ``all`` keeps every pixel, with black borders (as far as
            the lens model reaches: no ray is seen beyond its fold).
    """
    import cv2

    height, width = image.shape[:2]
    straight = straight_focal(width, height, focal, k1, k2, keep)
    fold = float(max_radius(torch.tensor(k1, dtype=torch.float64), torch.tensor(k2, dtype=torch.float64)))
    border = cv2.BORDER_REPLICATE if keep == "crop" else cv2.BORDER_CONSTANT
    result = np.empty_like(image)
    x = (np.arange(width) + 0.5 - width / 2) / straight
    for start in range(0, height, STRIP):
        y = (np.arange(start, min(start + STRIP, height)) + 0.5 - height / 2)[:, None] / straight
        square = x * x + y * y
        factor = focal * (1 + square * (k1 + k2 * square))
        if square.max() > fold * fold:
            factor = np.where(square > fold * fold, np.inf, factor)
        columns = (factor * x + (width / 2 - 0.5)).astype(np.float32)  # OpenCV's pixels have their centres at integers
        rows = (factor * y + (height / 2 - 0.5)).astype(np.float32)
        if not np.isfinite(factor).all():
            columns, rows = (np.where(np.isfinite(factor), m, np.float32(-10)) for m in (columns, rows))
        result[start : start + STRIP] = cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderMode=border)
    return result, straight


def straight_focal(width: int, height: int, focal: float, k1: float, k2: float, keep: Keep) -> float:
    """Focal length (pixels) of the undistorted picture of the same size that has no borders, or keeps everything.

    Towards a point of the photo's edge at R pixels from the centre, the lens sees up to the radius
    ``r = undistort(R / f)``, and an undistorted picture of the same size with focal length g sees up to ``R / g``. So g
    is the largest (``crop``) or smallest (``all``) of ``R / r`` along the edge.
    """
    radius = torch.linspace(min(width, height) / 2, math.hypot(width, height) / 2, 4096, dtype=torch.float64)
    coefficients = (torch.tensor(value, dtype=torch.float64) for value in (k1, k2))
    candidates = radius / undistort_radius(radius / focal, *coefficients)
    return float(candidates.max() if keep == "crop" else candidates.min())
