r"""Radial distortion in image heights, in NumPy: fast enough for the inner loop of a search.

With :math:`R = f r` the distortion :math:`r_d = r(1 + k_1 r^2 + k_2 r^4)` reads
:math:`R_d = R(1 + \hat k_1 R^2 + \hat k_2 R^4)`, :math:`\hat k_1 = k_1/f^2`, :math:`\hat k_2 = k_2/f^4`, so that the
straightness of lines determines :math:`\hat k_1` but not f. In the lens family of Lopez-Antequera et al. (2019)
:math:`\hat k_2 = 0.805\,\hat k_1^2 + 0.019\,\hat k_1/f^2`, and only the last, tiny term needs f.

It equals :func:`sextant.geometry.undistort_radius`, without gradients; torch's overhead per call would be ten times the
cost of the arithmetic.
"""

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

#: Steps of Newton's method from R = R_d: with this lens family and a focal length above a third of the longer side the
#: slope never falls below 0.4, and 8 are exact; shorter lenses are nearly flat before they fold.
STEPS = 20


def apparent_k2(k1_hat: Float[ndarray, "*b"] | float, focal: Float[ndarray, "*b"] | float) -> Float[ndarray, "*b"]:
    """Second coefficient in image heights of a lens with first coefficient ``k1_hat`` and focal length ``focal``."""
    return np.asarray(0.805 * np.square(k1_hat) + 0.019 * np.asarray(k1_hat) / np.square(focal))


def undistort_factor(
    square: Float[ndarray, "*#b"], k1_hat: Float[ndarray, "*#b"] | float, k2_hat: Float[ndarray, "*#b"] | float
) -> Float[ndarray, "*#b"]:
    """Ratio ``R / R_d`` of undistorted to distorted radius, at the squared distorted radius ``square``.

    Solves ``t (1 + A t^2 + B t^4) = 1`` for the ratio t, with ``A = k1_hat R_d^2``, ``B = k2_hat R_d^4``. Where a short
    lens folds before it reaches R_d, this is the ratio at the fold, as in :func:`sextant.geometry.max_radius`.
    """
    a, b = np.asarray(k1_hat * square), np.asarray(k2_hat * square * square)
    folds, fold = _fold(a, b)
    lost = folds & (fold * (1 + fold * fold * (a + b * fold * fold)) < 1)
    if lost.any():
        a, b = np.where(lost, 0.0, a), np.where(lost, 0.0, b)
    ratio = np.ones_like(a)
    for _ in range(STEPS if a.any() or b.any() else 0):
        t2 = ratio * ratio
        step = (ratio * (1 + t2 * (a + b * t2)) - 1) / (1 + t2 * (3 * a + 5 * b * t2))
        ratio = ratio - step
        if np.abs(step).max(initial=0) < 1e-8:  # the next would be its square
            break
    return np.where(lost, fold, ratio) if lost.any() else ratio


def _fold(a: Float[ndarray, "*b"], b: Float[ndarray, "*b"]) -> tuple[Bool[ndarray, "*b"], Float[ndarray, "*b"]]:
    """Whether ``t (1 + A t^2 + B t^4)`` stops growing anywhere, and the first t at which it does; else 1."""
    root = np.sqrt(np.maximum(9 * a * a - 20 * b, 0))
    folds = (root > 3 * a) & (root > 0)
    return folds, np.sqrt(np.where(folds, 2, 1) / np.where(folds, root - 3 * a, 1))


def undistort_points(
    points: Float[ndarray, "*#b 2"], k1_hat: Float[ndarray, "*#b"] | float, k2_hat: Float[ndarray, "*#b"] | float
) -> Float[ndarray, "*#b 2"]:
    """Undistorted positions of image points (image heights from the centre)."""
    return np.asarray(points * undistort_factor(np.square(points).sum(-1), k1_hat, k2_hat)[..., None])


def distort_points(points: Float[ndarray, "*b 2"], k1_hat: float, k2_hat: float) -> Float[ndarray, "*b 2"]:
    """The inverse of :func:`undistort_points`."""
    square = np.square(points).sum(-1, keepdims=True)
    return np.asarray(points * (1 + square * (k1_hat + k2_hat * square)))
