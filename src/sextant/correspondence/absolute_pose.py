r"""The pose of a camera from matches of its pixels with points of the world.

The pose minimises a robust reprojection error over the inliers of a LO-RANSAC (poselib). Its covariance is that of the
right perturbation :math:`T \exp(\xi)`, :math:`\xi = (t, \omega)` in the axes of the camera (metres, radians):

.. math:: \Sigma = \Bigl(\sum_i J_i^\top S_i^{-1} J_i\Bigr)^{-1}, \qquad
          J_i = P_i \, [-I \;\; [X_i]_\times], \qquad S_i = \sigma^2 I + P_i R^\top \Sigma_{X_i} R P_i^\top,

with the points :math:`X_i` in the camera, the projection's derivatives :math:`P_i`, the covariances of the points
:math:`\Sigma_{X_i}`, and the variance of the pixels :math:`\sigma^2` such that the inliers' weighted squared residuals
:math:`e_i^\top S_i^{-1} e_i` sum to their degrees of freedom (Paule and Mandel, 1982).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from sextant.correspondence.pinhole import Pinhole, cross_matrices
from sextant.errors import naming_extras
from sextant.ranges import NonNegative, Positive, checked
from sextant.shapes import check_shape

#: matches that determine a pose, with one left to check it
LEAST_MATCHES = 4
#: focal lengths that are tried where it is unknown, in longer sides of the image: 10 to 100 degrees wide
FOCAL_LENGTHS = np.geomspace(0.4, 5.7, 14)
#: least variance of a pixel coordinate: a keypoint is never known better than to about a quarter of a pixel
LEAST_VARIANCE = 0.05
#: steps of Gauss-Newton, and the change of pixels at which it ends
STEPS, SETTLED_PX = 20, 1e-4
#: matches by which focal lengths are compared; the best is then estimated by all
SEARCHED = 500


@dataclass(frozen=True, eq=False)
class EstimatedPose:
    """A pose from correspondences.

    Attributes:
        world_from_camera: x right, y down, z forward.
        covariance: of a displacement (metres, 3) and a rotation (radians, 3) in the axes of the camera.
        inliers: of the matches.
        camera: the camera, with its estimated focal length if that was unknown.
        focal_sigma: standard deviation of the focal length relative to it; 0 if it was known.
        residual_px: estimated standard deviation of a pixel coordinate.
    """

    world_from_camera: Float64[ndarray, "4 4"]
    covariance: Float64[ndarray, "6 6"]
    inliers: Bool[ndarray, "n"]
    camera: Pinhole
    focal_sigma: float
    residual_px: float


@checked
def absolute_pose(
    pixels: Float64[ndarray, "n 2"],
    points: Float64[ndarray, "n 3"],
    camera: Pinhole,
    *,
    focal_sigma: NonNegative | None = 0.0,
    covariances: Float64[ndarray, "n 3 3"] | None = None,
    error_px: Positive = 4.0,
) -> EstimatedPose | None:
    """Estimate the pose of a camera from matches, of which many may be wrong.

    Args:
        pixels: pixels of the image.
        points: points of the world, one a pixel.
        camera: the camera.
        focal_sigma: standard deviation of its focal length relative to it (a prior in the logarithm); 0: it is known;
            None: it is unknown, and that of ``camera`` is not used.
        covariances: of the points; None: they are exact.
        error_px: largest reprojection error of an inlier.

    Returns:
        None if fewer than four matches agree.

    Raises:
        ArgumentError: pixels, points or covariances have other shapes or differ in number, or ``focal_sigma`` or
            ``error_px`` is out of range.

    Example:
        >>> camera = Pinhole.centred(640, 480, 500.0)
        >>> points = np.random.default_rng(0).uniform((-2, -2, 4), (2, 2, 8), (50, 3))
        >>> found = absolute_pose(camera.project(points), points, camera)
        >>> bool(np.abs(found.world_from_camera - np.eye(4)).max() < 1e-6)
        True
    """
    pixels, points = np.asarray(pixels, np.float64), np.asarray(points, np.float64)
    check_shape("pixels", pixels, "n", 2)
    check_shape("points", points, len(pixels), 3)
    if covariances is not None:
        check_shape("covariances", covariances, len(points), 3, 3)
    if len(pixels) < LEAST_MATCHES:
        return None
    widest = max(camera.width, camera.height)
    if focal_sigma is None:
        tried = [camera.of_focal_length(widest * each) for each in FOCAL_LENGTHS]
    elif focal_sigma > 0:
        tried = [camera.of_focal_length(camera.fx * np.exp(focal_sigma * z)) for z in (-2, -1, 0, 1, 2)]
    else:
        tried = [camera]
    best = tried[0] if len(tried) == 1 else _best_supported(pixels, points, tried, error_px)
    pose, info = _ransac(pixels, points, best, error_px)
    inliers = np.asarray(info["inliers"], bool)
    if inliers.sum() < LEAST_MATCHES:
        return None
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = pose.R.T, -pose.R.T @ pose.t
    refined = _Refinement(pixels, points, covariances, camera, focal_sigma, error_px)
    return refined.run(rigid, best, inliers)


def _ransac(pixels: ndarray, points: ndarray, camera: Pinhole, error_px: float) -> tuple[Any, dict[str, Any]]:
    with naming_extras("poses from correspondences"):
        import poselib
    ransac = {"max_reproj_error": error_px, "max_iterations": 10_000, "min_iterations": 200}
    pose, info = poselib.estimate_absolute_pose(pixels, points, camera.poselib(), ransac, {})
    return pose, info


def _best_supported(pixels: ndarray, points: ndarray, tried: list[Pinhole], error_px: float) -> Pinhole:
    """The camera with which most of some of the matches agree."""
    rows = np.linspace(0, len(pixels) - 1, min(len(pixels), SEARCHED)).astype(int)
    return max(tried, key=lambda camera: _support(_ransac(pixels[rows], points[rows], camera, error_px)[1]))


def _support(info: dict[str, Any]) -> tuple[int, float]:
    return int(info["num_inliers"]), -float(info["model_score"])


@dataclass(frozen=True, eq=False)
class _Refinement:
    """The last estimate: all inliers, their points' uncertainty, and the focal length where it is not known."""

    pixels: ndarray
    points: ndarray
    covariances: ndarray | None
    prior: Pinhole
    focal_sigma: float | None
    error_px: float

    def run(self, pose: ndarray, camera: Pinhole, inliers: ndarray) -> EstimatedPose | None:
        """Alternate between a robust estimate and the choice of inliers; the last estimate weighs them by their S."""
        for _ in range(2):
            pose, camera = self._minimised(pose, camera, inliers, None)
            error = self._errors(pose, camera)
            inliers = np.nan_to_num(np.linalg.norm(error, axis=1), nan=np.inf) < self.error_px
            if inliers.sum() < LEAST_MATCHES:
                return None
        spread, variance = self._spread(pose, camera, inliers)
        weights = np.linalg.inv(spread + variance * np.eye(2))
        pose, camera = self._minimised(pose, camera, inliers, weights)
        return self._with_covariance(pose, camera, inliers, weights, variance)

    @property
    def _free(self) -> bool:
        return self.focal_sigma is None or self.focal_sigma > 0

    def _errors(self, pose: ndarray, camera: Pinhole) -> Float64[ndarray, "n 2"]:
        return np.asarray(camera.project((self.points - pose[:3, 3]) @ pose[:3, :3]) - self.pixels)

    def _spread(self, pose: ndarray, camera: Pinhole, inliers: ndarray) -> tuple[ndarray, float]:
        """The covariances of the points as pixels, and the variance of a pixel coordinate beyond them."""
        error = self._errors(pose, camera)[inliers]
        inside = (self.points[inliers] - pose[:3, 3]) @ pose[:3, :3]
        spread = np.zeros((len(inside), 2, 2))
        if self.covariances is not None:
            turned = camera.jacobian(inside) @ pose[:3, :3].T
            spread = turned @ self.covariances[inliers] @ turned.transpose(0, 2, 1)
        return spread, _pixel_variance(error, spread, 7 if self._free else 6)

    def _minimised(
        self, pose: ndarray, camera: Pinhole, inliers: ndarray, weights: ndarray | None
    ) -> tuple[ndarray, Pinhole]:
        """Least weighted squares, or a robust sum without weights, by damped Gauss-Newton."""
        pixels, points = self.pixels[inliers], self.points[inliers]
        scale = self.error_px / 2

        def cost(pose: ndarray, camera: Pinhole) -> tuple[float, ndarray, ndarray]:
            """The sum, the errors, and their weights: of Huber's smooth loss where none are given."""
            inside = (points - pose[:3, 3]) @ pose[:3, :3]
            error = np.nan_to_num(camera.project(inside) - pixels, nan=1e3)
            prior = (np.log(camera.fx / self.prior.fx) / self.focal_sigma) ** 2 if self.focal_sigma else 0.0
            if weights is not None:
                return float(np.einsum("nk,nkl,nl->", error, weights, error)) + prior, error, weights
            root = np.sqrt(1 + (error**2).sum(1) / scale**2)
            return float(2 * scale**2 * (root - 1).sum()) + prior, error, np.eye(2) / root[:, None, None]

        damping, (best, error, weight) = 1e-6, cost(pose, camera)
        for _ in range(STEPS):
            inside = (points - pose[:3, 3]) @ pose[:3, :3]
            jacobian = self._jacobian(inside, camera)
            weighted = np.einsum("nki,nkl->nil", jacobian, weight)
            information = np.einsum("nil,nlj->ij", weighted, jacobian)
            gradient = np.einsum("nil,nl->i", weighted, error)
            if self.focal_sigma:  # weighed against pixels of a standard deviation of 1
                information[6, 6] += 1 / self.focal_sigma**2
                gradient[6] += np.log(camera.fx / self.prior.fx) / self.focal_sigma**2
            damped = information + damping * np.diag(np.diag(information) + 1e-12)
            step = -np.linalg.lstsq(damped, gradient, rcond=None)[0]
            step[-1:] = np.clip(step[-1:], -0.3, 0.3) if self._free else step[-1:]
            lens = camera.of_focal_length(camera.fx * np.exp(step[6])) if self._free else camera
            moved = pose @ exponential(step[:6])
            found = cost(moved, lens)
            if found[0] > best:
                damping = max(1e-4, damping * 10)
                continue
            pose, camera, (best, error, weight) = moved, lens, found
            damping /= 10
            if np.abs(jacobian @ step).max(initial=0.0) < SETTLED_PX:
                break
        return pose, camera

    def _jacobian(self, inside: Float64[ndarray, "n 3"], camera: Pinhole) -> ndarray:
        """Derivatives of pixels by a displacement, a rotation and, where free, the logarithm of the focal length."""
        moved = np.concatenate([np.tile(-np.eye(3), (len(inside), 1, 1)), cross_matrices(inside)], 2)
        jacobian: ndarray = camera.jacobian(inside) @ moved
        if not self._free:
            return np.asarray(jacobian)
        by_focal = np.nan_to_num(camera.project(inside) - (camera.cx, camera.cy))
        return np.concatenate([jacobian, by_focal[:, :, None]], 2)

    def _with_covariance(
        self, pose: ndarray, camera: Pinhole, inliers: ndarray, weights: ndarray, variance: float
    ) -> EstimatedPose | None:
        inside = (self.points[inliers] - pose[:3, 3]) @ pose[:3, :3]
        jacobian = self._jacobian(inside, camera)
        information = np.einsum("nki,nkl,nlj->ij", jacobian, weights, jacobian)
        if self.focal_sigma:
            information[6, 6] += 1 / self.focal_sigma**2
        if not np.isfinite(information).all() or np.linalg.cond(information) > 1e15:
            return None
        covariance = np.linalg.inv(information)
        focal = float(np.sqrt(covariance[6, 6])) if self._free else 0.0
        return EstimatedPose(pose, covariance[:6, :6], inliers, camera, focal, float(np.sqrt(variance)))


def _pixel_variance(error: ndarray, spread: ndarray, unknowns: int) -> float:
    """The variance of a pixel coordinate, beyond that of the points, that explains the residuals of the inliers."""
    values, axes = np.linalg.eigh(spread)
    squared, freedom = np.einsum("nk,nkl->nl", error, axes) ** 2, max(1, error.size - unknowns)

    def excess(variance: float) -> float:
        return float((squared / (values + variance)).sum()) - freedom

    most = float(squared.sum()) / freedom
    if most <= LEAST_VARIANCE or excess(LEAST_VARIANCE) <= 0:
        return LEAST_VARIANCE
    if excess(most) >= 0:  # exact points
        return most
    return float(brentq(excess, LEAST_VARIANCE, most, xtol=1e-4))


def exponential(step: Float64[ndarray, "6"]) -> Float64[ndarray, "4 4"]:
    """The rigid motion of a displacement and a rotation vector, the rotation first."""
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = Rotation.from_rotvec(step[3:]).as_matrix(), step[:3]
    return rigid
