r"""The focal length of photos of a camera that only turned, which sees no point from two sides.

Pixels of two photos then are one homography apart, :math:`x' \sim K R K^{-1} x`. The rotations of all photos, the focal
length, the principal point's offset and the distortion, with the priors of :mod:`sextant.correspondence.bundle`, have
the least sum of the squared differences of the directions of matches, with a soft bound (``soft_l1``). A camera that
did not turn, or only about its axis, has the same sum at any focal length, so that it is minimised at several of them.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sextant.correspondence.bundle import DISTORTION, LARGEST_PX, PRINCIPAL_POINT
from sextant.correspondence.first_scene import Pair
from sextant.errors import naming_extras
from sextant.shapes import check_shape

Matched = Mapping[Pair, tuple[Float64[ndarray, "m 2"], Float64[ndarray, "m 2"]]]
#: steps of the search; it starts near
EVALUATIONS = 50
#: first step along the logarithm of the focal length, and by how much each is longer than the one before
STEP, LONGER = 0.0025, 1.4


class Turned(NamedTuple):
    """What turns say of the focal length.

    Attributes:
        logs: logarithms of focal lengths, ascending.
        deviations: the least deviation at each.
        variance: of a coordinate of a pixel.
        explained: matches that turns explain.
        photos: that are joined by turns.
    """

    logs: Float64[ndarray, "k"]
    deviations: Float64[ndarray, "k"]
    variance: float
    explained: int
    photos: list[int]


def turns_of(
    matched: Matched, focal_lengths: Float64[ndarray, "g"]
) -> tuple[float, dict[Pair, Float64[ndarray, "3 3"]], dict[Pair, int]]:
    """The focal length of several at which turns alone explain most matches, these turns, and how many they explain.

    Args:
        matched: pixels of pairs, from the centres of their photos.
        focal_lengths: that are tried.

    Raises:
        ArgumentError: the pixels of a pair differ in number.
    """
    for first, second in matched.values():
        check_shape("first", first, "m", 2)
        check_shape("second", second, len(first), 2)
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
    matched: Matched,
    focal: float,
    turns: Mapping[Pair, ndarray],
    side: float,
    *,
    ends: tuple[float, float],
    overdispersion: float,
    weighed: float,
) -> Turned:
    """The deviation along the focal length.

    Args:
        matched: as above.
        focal, turns: where to start.
        side: longer side of the photos.
        ends: least and largest logarithm of the focal length.
        overdispersion: by how much the variance of a pixel exceeds that of independent errors.
        weighed: deviations above the least one up to which focal lengths matter.
    """
    first = _from_first(turns)
    photos = list(first)
    rotations = [Rotation.from_matrix(first[k]).as_rotvec() for k in photos[1:]]
    pairs = {}
    for (i, j), pixels in matched.items():
        if i in first and j in first:
            right = _transfer(*pixels, first[j] @ first[i].T, focal) < (4 * LARGEST_PX) ** 2
            pairs[i, j] = pixels[0][right], pixels[1][right]

    def errors(x: ndarray) -> ndarray:
        matrices = np.concatenate([np.eye(3)[None], Rotation.from_rotvec(x[4:].reshape(-1, 3)).as_matrix()])
        of = dict(zip(photos, matrices, strict=True))
        return np.concatenate(
            [_difference(*pixels, of[j] @ of[i].T, x, side).ravel() for (i, j), pixels in pairs.items()]
        )

    prior = np.array([DISTORTION, PRINCIPAL_POINT * side, PRINCIPAL_POINT * side])
    start = np.concatenate([[np.clip(np.log(focal), *ends), 0, 0, 0], *rotations])
    found, _ = _least(errors, start, prior, 1.0)
    variance = max(float(np.median(errors(found) ** 2)) / 0.455, 1e-6)  # the median of chi2_1
    explained = int(((errors(found).reshape(-1, 2) ** 2).sum(1) < LARGEST_PX**2).sum())
    logs, deviations = _along(lambda x: _least(errors, x, prior, variance * overdispersion), found, ends, weighed)
    return Turned(logs, deviations, variance, explained, photos)


def _least(errors: Callable[[ndarray], ndarray], x: ndarray, prior: ndarray, variance: float) -> tuple[ndarray, float]:
    """The least deviation at the focal length of ``x``, and where."""
    scale = variance**0.5

    def residuals(rest: ndarray) -> ndarray:
        return np.concatenate([errors(np.append(x[0], rest)) / scale, rest[:3] / prior])

    found = least_squares(
        residuals, x[1:], loss="soft_l1", f_scale=1 / scale, max_nfev=EVALUATIONS, x_scale="jac", ftol=1e-6
    )
    return np.append(x[0], found.x), 2 * float(found.cost)


def _along(
    least: Callable[[ndarray], tuple[ndarray, float]], start: ndarray, ends: tuple[float, float], weighed: float
) -> tuple[Float64[ndarray, "k"], Float64[ndarray, "k"]]:
    """Logarithms of focal lengths, ascending, and deviations there, as far as these are near the least one."""
    begun = least(start)
    found = [begun]
    for way in (-1, 1):
        (last, deviation), size = begun, STEP
        while ends[0] < last[0] + way * 1e-9 < ends[1] and deviation < min(each for _, each in found) + weighed:
            at = last.copy()
            at[0] = np.clip(last[0] + way * size, *ends)
            last, deviation = least(at)
            found.append((last, deviation))
            size *= LONGER
    found.sort(key=lambda each: float(each[0][0]))
    return np.array([x[0] for x, _ in found]), np.array([deviation for _, deviation in found])


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
    """Differences in pixels: without distortion, lengths near a pixel are larger by ``1 + 2 k r²``, and errors too."""
    focal = np.exp(x[0])
    offsets = [pixels - x[2:4] for pixels in (one, two)]
    here, larger = (x[1] * (offset**2).sum(1, keepdims=True) / side**2 for offset in offsets)
    there = np.column_stack([offsets[0] * (1 + here) / focal, np.ones(len(one))]) @ turn.T
    apart = there[:, :2] / np.maximum(there[:, 2:], 1e-3) * focal - offsets[1] * (1 + larger)
    return np.asarray(apart / np.maximum(1 + here + larger, 0.1))


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
