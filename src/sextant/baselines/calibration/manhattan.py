r"""The camera that makes line segments point to three orthogonal vanishing points.

A world of boxes has edges along three orthogonal axes, one of them vertical. A camera
:math:`x = (\theta, \psi, \alpha, \log f, \hat k_1)` with the heading α to one of the horizontal axes has these as the
columns w of :math:`R = (R_x(\theta) R_z(\psi))^\top R_y(\alpha)`, with vanishing points :math:`f (w_x, w_y) / w_z`.
A segment with direction d and midpoint m, both after undistortion, fits an axis if d is parallel to
:math:`e = (f w_x - m_u w_z,\; f w_y - m_v w_z)`, which is finite for axes parallel to the image as well. The residual
is the sine of their angle over its standard deviation, which combines the noise of the segment's ends with the
deviation of real edges from the axes. The estimate maximizes the posterior under Cauchy noise and a Gaussian prior.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from numpy import ndarray

from sextant.baselines.calibration.estimate import CameraPrior
from sextant.baselines.calibration.lens import apparent_k2, undistort_points
from sextant.baselines.calibration.line_segments import segment_lengths
from sextant.baselines.calibration.robust_fit import HIGH, LOW, RobustFit
from sextant.baselines.calibration.terms import Term, student

#: Standard deviations: of a segment's end across it, in image heights; of a real edge from its axis, in radians.
END_NOISE, WORLD_NOISE = 0.0012, np.radians(0.4)
#: Segments farther than this from an axis are not assigned to it.
THRESHOLD = np.radians(2.5)
#: Thresholds while the camera is only roughly known.
FIRST_ROUND = (2 * THRESHOLD,)
#: Errors of segments in one picture are correlated: their total weight is at most that of this many.
EFFECTIVE_SEGMENTS = 25.0
#: cost of a segment that fits no axis: that of one at the threshold
OUTLIER = 0.5 * math.log1p((math.sin(THRESHOLD) / WORLD_NOISE) ** 2)
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


class AlignedSegments(Term):
    """Residuals of segments, which point to the vanishing points that they are assigned to.

    Args:
        segments: distorted ends in image heights.
        axis: axis of each segment: 0 right, 1 down, 2 forward.
        share: weight of each segment, which bounds the total weight of a picture's segments.
        certainty: see :class:`~sextant.baselines.calibration.terms.Term`.
        shorter: shorter side of the photo in image heights, of which the noise of ends is a fraction.
    """

    def __init__(
        self,
        segments: Float64[ndarray, "n 2 2"],
        axis: Int[ndarray, "n"],
        share: float,
        certainty: float = 1.0,
        shorter: float = 1.0,
    ):
        self.segments, self.axis, self.share, self.certainty = segments, axis, share, certainty
        self.noise = np.hypot(WORLD_NOISE, 2 * END_NOISE * shorter / segment_lengths(segments))

    def residuals(self, vectors: Float64[ndarray, "b 5"]) -> Float64[ndarray, "b n"]:
        """Sines of the angles between segments and the directions to their vanishing points."""
        axes = np.take_along_axis(camera_axes(vectors), self.axis[None, None], axis=2)
        return sines_to(axes, np.exp(vectors[:, 3, None]), straightened(vectors, self.segments)) / self.noise

    def loss(self, squares: Float64[ndarray, "*b n"]) -> Float64[ndarray, "3 *b n"]:
        """Cauchy's loss."""
        more = 1 + squares
        return self.share * np.stack([np.log(more), 1 / more, -1 / np.square(more)])


class Normal(Term):
    """A camera that is known up to normal errors, in all but its heading.

    Args:
        prior: the camera and its standard deviations.
    """

    def __init__(self, prior: CameraPrior):
        self.mean, self.sigma = prior.vector, np.array(prior.sigma)

    def residuals(self, vectors: Float64[ndarray, "b 5"]) -> Float64[ndarray, "b 4"]:
        """Residuals of tilt, roll, log focal and k1_hat."""
        return np.asarray((vectors[:, BELIEFS] - self.mean) / self.sigma)

    def loss(self, squares: Float64[ndarray, "*b 4"]) -> Float64[ndarray, "3 *b 4"]:
        """The loss of a normal distribution."""
        return student(squares, math.inf)


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
    vector, belief = np.clip(start, LOW + 1e-6, HIGH - 1e-6), Normal(prior)
    for threshold in thresholds:
        axis, near = nearest_axis(vector, segments, threshold)
        inliers = int(near.sum())
        share = min(1.0, EFFECTIVE_SEGMENTS / max(inliers, 1))
        terms = [AlignedSegments(segments[near], axis[near], share), belief]
        fit = RobustFit(terms, np.arange(5 if bent else 4), vector, tolerance=1e-6, evaluations=20)
        vector = fit.solve(vector)
    information = fit.information(vector)
    if not bent:
        information[4, 4] = prior.sigma[3] ** -2
    information[2, 2] += 1e-6  # the heading may be undetermined
    # an outlier costs as much as a segment at the threshold, so that discarding segments does not reduce the cost
    cost = fit.cost(vector) + OUTLIER * share * (len(segments) - inliers)
    return ManhattanFit(vector, np.linalg.inv(information), cost, inliers)
