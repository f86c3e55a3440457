r"""The focal length of photos of a camera that only turned, which sees no point from two sides.

Pixels of two photos then are one homography apart, :math:`x' \sim K R K^{-1} x`. The rotations of all photos, the focal
length, the principal point's offset and the distortion, with the priors of :mod:`sextant.correspondence.bundle`, have
the least sum of the squared differences of the directions of matches, with a soft bound (``soft_l1``).
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sextant.correspondence.bundle import DISTORTION, LARGEST_PX, PRINCIPAL_POINT
from sextant.correspondence.first_scene import Pair
from sextant.errors import naming_extras

Matched = Mapping[Pair, tuple[Float64[ndarray, "m 2"], Float64[ndarray, "m 2"]]]
#: steps of the search; it starts near
EVALUATIONS = 50


def turns_of(
    matched: Matched, focal_lengths: Float64[ndarray, "g"]
) -> tuple[float, dict[Pair, Float64[ndarray, "3 3"]], dict[Pair, int]]:
    """The focal length of several at which turns alone explain most matches, these turns, and how many they explain.

    Args:
        matched: pixels of pairs, from the centres of their photos.
        focal_lengths: that are tried.
    """
    with naming_extras("geometry of matches"):
        import poselib
    ransac = {"max_reproj_error": LARGEST_PX, "max_iterations": 2000, "min_iterations": 100}
    planes = {pair: poselib.estimate_homography(*pixels, ransac, {})[0] for pair, pixels in matched.items()}
    best: tuple[float, dict[Pair, ndarray], dict[Pair, int]] = (0.0, {}, dict.fromkeys(matched, -1))
    for focal in focal_lengths.tolist():
        turns = {pair: _turn(np.asarray(plane), focal) for pair, plane in planes.items()}
        explained = {
            pair: int((_transfer(*matched[pair], turn, focal) < LARGEST_PX**2).sum()) for pair, turn in turns.items()
        }
        if sum(explained.values()) > sum(best[2].values()):
            best = focal, turns, explained
    return best


def turned_focal(
    matched: Matched, focal: float, turns: Mapping[Pair, ndarray], side: float
) -> tuple[float, float, float, int, list[int]]:
    """Logarithm of the focal length, its variance per unit of variance of a pixel, that variance, how many matches are
    explained, and the photos.

    Args:
        matched: as above.
        focal, turns: where to start.
        side: longer side of the photos.
    """
    first = _from_first(turns)
    photos = list(first)
    start = np.concatenate(
        [[np.log(focal), 0, 0, 0], *(Rotation.from_matrix(first[k]).as_rotvec() for k in photos[1:])]
    )
    pairs = {}
    for (i, j), pixels in matched.items():
        if i in first and j in first:
            right = _transfer(*pixels, first[j] @ first[i].T, focal) < (4 * LARGEST_PX) ** 2
            pairs[i, j] = pixels[0][right], pixels[1][right]
    prior = np.array([DISTORTION, PRINCIPAL_POINT * side, PRINCIPAL_POINT * side])

    def residuals(x: ndarray) -> ndarray:
        matrices = np.concatenate([np.eye(3)[None], Rotation.from_rotvec(x[4:].reshape(-1, 3)).as_matrix()])
        of = dict(zip(photos, matrices, strict=True))
        parts = [_difference(*pixels, of[j] @ of[i].T, x, side).ravel() for (i, j), pixels in pairs.items()]
        return np.concatenate([*parts, x[1:4] / prior])

    found = least_squares(residuals, start, loss="soft_l1", max_nfev=EVALUATIONS, x_scale="jac")
    variance = float(np.median(found.fun[:-3] ** 2)) / 0.455  # the median of chi2_1
    data, others = found.jac[:-3], np.diag(np.concatenate([[0], prior**-2, np.zeros(len(start) - 4)]))
    per_unit = float(np.linalg.pinv(data.T @ data / max(variance, 1e-6) + others)[0, 0]) / max(variance, 1e-6)
    errors = residuals(found.x)[:-3].reshape(-1, 2)
    return float(found.x[0]), per_unit, variance, int(((errors**2).sum(1) < LARGEST_PX**2).sum()), photos


def _turn(homography: ndarray, focal: float) -> ndarray:
    """The rotation nearest to a homography."""
    scale = np.array([focal, focal, 1.0])
    normal = homography * scale[None] / scale[:, None]
    left, _, right = np.linalg.svd(normal * np.sign(np.linalg.det(normal)))
    return np.asarray(left @ right)


def _transfer(one: ndarray, two: ndarray, turn: ndarray, focal: float) -> ndarray:
    """Squared errors in pixels."""
    return np.asarray((_difference(one, two, turn, np.array([np.log(focal), 0.0, 0.0, 0.0]), 1.0) ** 2).sum(1))


def _difference(one: ndarray, two: ndarray, turn: ndarray, x: ndarray, side: float) -> ndarray:
    focal = np.exp(x[0])
    rays = []
    for pixels in (one, two):
        offset = pixels - x[2:4]
        rays.append(offset * (1 + x[1] * (offset**2).sum(1, keepdims=True) / side**2) / focal)
    there = np.column_stack([rays[0], np.ones(len(one))]) @ turn.T
    return np.asarray((there[:, :2] / np.maximum(there[:, 2:], 1e-3) - rays[1]) * focal)


def _from_first(turns: Mapping[Pair, ndarray]) -> dict[int, ndarray]:
    """The rotation of each photo that is joined with the first one by pairs, from its axes."""
    found = {min(min(pair) for pair in turns): np.eye(3)}
    while True:
        new = {}
        for (i, j), turn in turns.items():
            if i in found and j not in found:
                new[j] = turn @ found[i]
            elif j in found and i not in found:
                new[i] = turn.T @ found[j]
        if not new:
            return found
        found |= new
