r"""Two views of a still scene by known cameras: their relative pose.

The essential matrix is found by five points (poselib's LO-RANSAC). A rotation alone determines no baseline; matches
then agree with a homography, which is reported instead.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from sextant.correspondence.pinhole import Pinhole
from sextant.errors import naming_extras

#: share of the inliers of an essential matrix that a homography may explain before the baseline is called undetermined
ROTATION_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class TwoViews:
    """Geometry of two images.

    Attributes:
        second_from_first: with a baseline of length 1.
        inliers: of the matches.
        only_rotation: a homography explains the matches as well: the camera only turned, or the scene is flat.
    """

    second_from_first: Float64[ndarray, "4 4"]
    inliers: Bool[ndarray, "n"]
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
    inliers = np.asarray(info["inliers"], bool)
    if inliers.sum() < 8:
        return None
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = pose.R, pose.t / max(float(np.linalg.norm(pose.t)), 1e-12)
    homography = {"max_reproj_error": 2 * error_px, "max_iterations": 2000, "min_iterations": 100}
    _, flat = poselib.estimate_homography(first[inliers], second[inliers], homography, {})
    return TwoViews(rigid, inliers, flat["num_inliers"] >= ROTATION_SHARE * inliers.sum())


def sampson_errors(
    first: Float64[ndarray, "n 2"], second: Float64[ndarray, "n 2"], essential: Float64[ndarray, "3 3"]
) -> Float64[ndarray, "n"]:
    r"""First-order distances from the epipolar constraint, signed:
    :math:`x_2^\top E x_1 / \sqrt{(E x_1)_1^2 + (E x_1)_2^2 + (E^\top x_2)_1^2 + (E^\top x_2)_2^2}`."""
    one, two = (np.column_stack([each, np.ones(len(each))]) for each in (first, second))
    lines, back = one @ essential.T, two @ essential
    length = np.sqrt((lines[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1)).clip(min=1e-12)
    return np.asarray(np.einsum("ni,ni->n", two, lines) / length)
