r"""The camera that makes line segments point to three orthogonal vanishing points.

A world of boxes has edges along three orthogonal axes, one of them vertical. A camera
:math:`x = (\theta, \psi, \alpha, \log f, \hat k_1)` with the heading α to one of the horizontal axes has these as the
columns w of :math:`R = (R_x(\theta) R_z(\psi))^\top R_y(\alpha)`, with vanishing points :math:`f (w_x, w_y) / w_z`.
A segment with direction d and midpoint m, both after undistortion, fits an axis if d is parallel to
:math:`e = (f w_x - m_u w_z,\; f w_y - m_v w_z)`, which is finite for axes parallel to the image as well. The residual
is the sine of their angle over its standard deviation, which combines the noise of the segment's ends with the
deviation of real edges from the axes. The estimate maximizes the posterior under Cauchy noise and a Gaussian prior.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from numpy import ndarray

from sextant.baselines.calibration.estimate import CameraPrior
from sextant.baselines.calibration.lens import apparent_k2, undistort_points
from sextant.baselines.calibration.line_segments import segment_lengths
from sextant.baselines.calibration.robust_fit import HIGH, LOW, RobustFit

#: Standard deviations: of a segment's end across it, in image heights; of a real edge from its axis, in radians.
END_NOISE, WORLD_NOISE = 0.0012, np.radians(0.4)
#: Segments farther than this from an axis are not assigned to it.
THRESHOLD = np.radians(2.5)
#: Thresholds while the camera is only roughly known.
FIRST_ROUND = (2 * THRESHOLD,)
#: Errors of segments in one picture are correlated: their total weight is at most that of this many.
EFFECTIVE_SEGMENTS = 25.0
#: Indices of tilt, roll, log focal and k1_hat among the five numbers.
BELIEFS = np.array([0, 1, 3, 4])


@dataclass(frozen=True)
class ManhattanFit:
    """A camera fitted to segments.

    Attributes:
        vector: tilt, roll, heading, log focal, k1_hat.
        covariance: covariance of the five numbers, from the curvature at the optimum.
        cost: half the negative log posterior, up to a constant: comparable between fits to the same segments.
        inliers: number of segments within :data:`THRESHOLD` of an axis.
    """

    vector: Float64[ndarray, "5"]
    covariance: Float64[ndarray, "5 5"]
    cost: float
    inliers: int


def camera_axes(vectors: Float64[ndarray, "b 5"]) -> Float64[ndarray, "b 3 3"]:
    """Directions in the camera frame, as columns, of the axes right, down and forward of the world of boxes."""
    (ct, cr, ch), (st, sr, sh) = np.cos(vectors[:, :3]).T, np.sin(vectors[:, :3]).T
    zero = np.zeros_like(ct)
    gravity_from_camera = np.array([[cr, -sr, zero], [ct * sr, ct * cr, -st], [st * sr, st * cr, ct]])
    gravity_from_world = np.array([[ch, zero, sh], [zero, zero + 1, zero], [-sh, zero, ch]])
    return np.asarray(np.einsum("jib,jkb->bik", gravity_from_camera, gravity_from_world))


def sines(vectors: Float64[ndarray, "b 5"], segments: Float64[ndarray, "n 2 2"]) -> Float64[ndarray, "b 3 n"]:
    """Signed sine of the angle between each undistorted segment and its direction to each vanishing point."""
    focal = np.exp(vectors[:, 3])
    return _sines(camera_axes(vectors), focal, straightened(vectors, segments))


def straightened(vectors: Float64[ndarray, "b 5"], segments: Float64[ndarray, "n 2 2"]) -> Float64[ndarray, "b n 2 2"]:
    """Ends of segments, undistorted by the lens of each camera."""
    k1_hat = vectors[:, 4, None, None]
    return undistort_points(segments[None], k1_hat, apparent_k2(k1_hat, np.exp(vectors[:, 3, None, None])))


def _sines(
    axes: Float[ndarray, "b 3 3"], focal: Float[ndarray, "b"], ends: Float[ndarray, "#b n 2 2"]
) -> Float[ndarray, "b 3 n"]:
    return np.stack([sines_to(axes[:, :, i, None], focal[:, None], ends) for i in range(3)], axis=1)


def sines_to(
    axes: Float[ndarray, "b 3 #n"], focal: Float[ndarray, "b 1"], ends: Float[ndarray, "#b n 2 2"]
) -> Float[ndarray, "b n"]:
    """The sines for one axis per segment, or one for all."""
    du, dv = ends[..., 1, 0] - ends[..., 0, 0], ends[..., 1, 1] - ends[..., 0, 1]
    mu, mv = (ends[..., 1, 0] + ends[..., 0, 0]) / 2, (ends[..., 1, 1] + ends[..., 0, 1]) / 2
    eu, ev = focal * axes[:, 0] - mu * axes[:, 2], focal * axes[:, 1] - mv * axes[:, 2]
    return np.asarray((du * ev - dv * eu) / np.sqrt((du * du + dv * dv) * (eu * eu + ev * ev) + 1e-18))


def msac_cost(
    axes: Float[ndarray, "b 3 3"], focal: Float[ndarray, "b"], segments: Float[ndarray, "n 2 2"]
) -> Float[ndarray, "b"]:
    """Share of the total length that fits no axis: truncated squares, from 0 to 1; segments are straight."""
    weight = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=-1)
    nearest = np.abs(_sines(axes, focal, segments[None])).min(axis=1)
    return np.asarray(np.minimum((nearest / np.sin(THRESHOLD)) ** 2, 1) @ (weight / weight.sum()))


def nearest_axis(
    vector: Float64[ndarray, "5"], segments: Float64[ndarray, "n 2 2"], threshold: float = THRESHOLD
) -> tuple[Int[ndarray, "n"], Bool[ndarray, "n"]]:
    """The axis (0 right, 1 down, 2 forward) nearest to each segment, and whether it is within the threshold."""
    distance = np.abs(sines(vector[None], segments)[0])
    return distance.argmin(axis=0), distance.min(axis=0) < np.sin(threshold)


def fit_manhattan(
    segments: Float64[ndarray, "n 2 2"],
    start: Float64[ndarray, "5"],
    prior: CameraPrior,
    *,
    bent: bool,
    thresholds: tuple[float, ...] = (THRESHOLD, THRESHOLD),
) -> ManhattanFit:
    """The best camera near ``start``, by alternating between the segments' axes and the five numbers.

    Args:
        segments: distorted ends in image heights.
        start: tilt, roll, heading, log focal, k1_hat.
        prior: belief about all but the heading.
        bent: whether k1_hat is fitted as well; otherwise it keeps the value of ``start``.
        thresholds: largest angle of a segment from its axis in each round, in radians.
    """
    vector = np.clip(start, LOW + 1e-6, HIGH - 1e-6)
    for threshold in thresholds:
        axis, near = nearest_axis(vector, segments, threshold)
        problem = _Problem(segments[near], axis[near], prior, np.arange(5 if bent else 4), vector)
        vector = problem.solve(vector)
    return problem.result(vector, outliers=int((~near).sum()))


class _Problem(RobustFit):
    """Residuals of segments with known axes and of the prior, over the ``free`` numbers among the five."""

    def __init__(
        self,
        segments: Float64[ndarray, "n 2 2"],
        axis: Int[ndarray, "n"],
        prior: CameraPrior,
        free: Int[ndarray, "k"],
        fixed: Float64[ndarray, "5"],
    ):
        super().__init__(free, fixed)
        self.segments, self.axis = segments, axis
        self.mean, self.sigma = prior.vector, np.array(prior.sigma)
        self.noise = np.hypot(WORLD_NOISE, 2 * END_NOISE / segment_lengths(segments))
        self.share = min(1.0, EFFECTIVE_SEGMENTS / max(len(segments), 1))

    def residuals_of(self, vectors: Float64[ndarray, "b 5"]) -> Float64[ndarray, "b m"]:
        axes = np.take_along_axis(camera_axes(vectors), self.axis[None, None], axis=2)  # (b, 3, n)
        ends = straightened(vectors, self.segments)
        data = sines_to(axes, np.exp(vectors[:, 3, None]), ends) / self.noise
        belief = (vectors[:, BELIEFS] - self.mean) / self.sigma
        return np.concatenate([data, belief], axis=1)

    def loss(self, squares: Float64[ndarray, "m"]) -> Float64[ndarray, "3 m"]:
        """Cauchy for the segments, whose total weight is at most :data:`EFFECTIVE_SEGMENTS`; Gaussian for the prior."""
        count = len(self.segments)
        rho = np.stack([squares, np.ones_like(squares), np.zeros_like(squares)])
        more = 1 + squares[:count]
        rho[:, :count] = self.share * np.stack([np.log(more), 1 / more, -1 / more**2])
        return rho

    def result(self, vector: Float64[ndarray, "5"], outliers: int) -> ManhattanFit:
        residuals = self.residuals(vector[None, self.free])[0]
        rho = self.loss(np.square(residuals))
        jacobian = self.jacobian(vector[self.free])
        information = np.zeros((5, 5))
        information[np.ix_(self.free, self.free)] = (jacobian * rho[1][:, None]).T @ jacobian
        if 4 not in self.free:
            information[4, 4] = self.sigma[3] ** -2
        information[2, 2] += 1e-6  # the heading may be undetermined
        # an outlier costs as much as a segment at the threshold, so that discarding segments does not reduce the cost
        bound = np.log1p(np.square(np.sin(THRESHOLD) / WORLD_NOISE)) * self.share
        cost = 0.5 * float(rho[0].sum()) + 0.5 * bound * outliers
        return ManhattanFit(vector, np.linalg.inv(information), cost, len(self.segments))
