r"""Two views of a still scene: relative pose, and the focal length that they share.

With known cameras, the essential matrix by five points; with one unknown focal length, by six (both in poselib's
LO-RANSAC). The interval of the focal length is from the curvature of the squared Sampson errors of the inliers, over
the focal length and the pose. A rotation alone determines no baseline; matches then agree with a homography, which is
reported instead.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sextant.correspondence.pinhole import Pinhole, cross_matrices
from sextant.errors import naming_extras

#: share of the inliers of an essential matrix that a homography may explain before the baseline is called undetermined
ROTATION_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class TwoViews:
    """Geometry of two images.

    Attributes:
        second_from_first: with a baseline of length 1.
        inliers: of the matches.
        focal_px: focal length of both images.
        focal_sigma: its standard deviation relative to it; 0 if it was known.
        only_rotation: a homography explains the matches as well: the camera only turned, or the scene is flat.
    """

    second_from_first: Float64[ndarray, "4 4"]
    inliers: Bool[ndarray, "n"]
    focal_px: float
    focal_sigma: float
    only_rotation: bool


def relative_pose(
    first: Float64[ndarray, "n 2"],
    second: Float64[ndarray, "n 2"],
    cameras: tuple[Pinhole, Pinhole],
    error_px: float = 1.5,
) -> TwoViews | None:
    """Relative pose of two known cameras from matched pixels; None if fewer than eight matches agree."""
    if len(first) < 8:
        return None
    with naming_extras("geometry of matches"):
        import poselib
    ransac = {"max_epipolar_error": error_px, "max_iterations": 10_000, "min_iterations": 200}
    pose, info = poselib.estimate_relative_pose(first, second, cameras[0].poselib(), cameras[1].poselib(), ransac, {})
    return _two_views(first, second, pose, np.asarray(info["inliers"], bool), cameras[0].fx, 0.0, error_px)


def shared_focal_length(
    first: Float64[ndarray, "n 2"],
    second: Float64[ndarray, "n 2"],
    size: tuple[int, int],
    error_px: float = 1.5,
) -> TwoViews | None:
    """The focal length that two images share, square pixels and a centred principal point assumed.

    Args:
        first, second: matched pixels.
        size: width and height of both images.
        error_px: largest Sampson error of an inlier.

    Returns:
        None if fewer than twelve matches agree.
    """
    if len(first) < 12:
        return None
    with naming_extras("geometry of matches"):
        import poselib
    centre = (np.array(size, np.float64) - 1) / 2
    ransac = {"max_epipolar_error": error_px, "max_iterations": 10_000, "min_iterations": 500, "real_focal_check": True}
    pair, info = poselib.estimate_shared_focal_relative_pose(first, second, centre, ransac, {})
    inliers = np.asarray(info["inliers"], bool)
    focal = float(pair.camera1.focal())
    if inliers.sum() < 12 or not 0 < focal < 100 * max(size):
        return None
    focal, sigma, rigid = _refined(first[inliers] - centre, second[inliers] - centre, focal, pair.pose.R, pair.pose.t)
    return _checked(rigid, first, second, inliers, focal, sigma, error_px)


def _two_views(
    first: ndarray, second: ndarray, pose: object, inliers: ndarray, focal: float, sigma: float, error_px: float
) -> TwoViews | None:
    if inliers.sum() < 8:
        return None
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = pose.R, pose.t / max(float(np.linalg.norm(pose.t)), 1e-12)  # type: ignore[attr-defined]
    return _checked(rigid, first, second, inliers, focal, sigma, error_px)


def _checked(
    rigid: ndarray, first: ndarray, second: ndarray, inliers: ndarray, focal: float, sigma: float, error_px: float
) -> TwoViews:
    """The result, with a note of whether a homography does as well."""
    import poselib

    ransac = {"max_reproj_error": 2 * error_px, "max_iterations": 2000, "min_iterations": 100}
    _, flat = poselib.estimate_homography(first[inliers], second[inliers], ransac, {})
    return TwoViews(rigid, inliers, focal, sigma, flat["num_inliers"] >= ROTATION_SHARE * inliers.sum())


def _refined(
    first: ndarray, second: ndarray, focal: float, rotation: ndarray, translation: ndarray
) -> tuple[float, float, ndarray]:
    """Focal length, its relative standard deviation, and the pose, by all inliers."""
    turn, way = Rotation.from_matrix(rotation).as_rotvec(), translation / max(float(np.linalg.norm(translation)), 1e-12)
    across = np.linalg.svd(way[None])[2][1:]  # the two directions in which a unit vector can move

    def unpacked(x: ndarray) -> tuple[float, ndarray, ndarray]:
        moved = way + x[4:] @ across
        return focal * np.exp(x[0]), Rotation.from_rotvec(turn + x[1:4]).as_matrix(), moved / np.linalg.norm(moved)

    def residuals(x: ndarray) -> ndarray:
        scale, matrix, direction = unpacked(x)
        essential = cross_matrices(direction[None])[0] @ matrix
        return np.asarray(sampson_errors(first / scale, second / scale, essential) * scale)

    found = least_squares(residuals, np.zeros(6), loss="soft_l1", max_nfev=100)
    variance = float((found.fun**2).sum()) / max(1, len(found.fun) - 6)
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac)
    scale, matrix, direction = unpacked(found.x)
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = matrix, direction
    return float(scale), float(np.sqrt(covariance[0, 0])), rigid


def sampson_errors(
    first: Float64[ndarray, "n 2"], second: Float64[ndarray, "n 2"], essential: Float64[ndarray, "3 3"]
) -> Float64[ndarray, "n"]:
    r"""First-order distances from the epipolar constraint, signed:
    :math:`x_2^\top E x_1 / \sqrt{(E x_1)_1^2 + (E x_1)_2^2 + (E^\top x_2)_1^2 + (E^\top x_2)_2^2}`."""
    one, two = (np.column_stack([each, np.ones(len(each))]) for each in (first, second))
    lines, back = one @ essential.T, two @ essential
    length = np.sqrt((lines[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1)).clip(min=1e-12)
    return np.asarray(np.einsum("ni,ni->n", two, lines) / length)
