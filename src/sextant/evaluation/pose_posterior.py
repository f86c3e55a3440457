r"""Calibration of posteriors over poses in the plane: whether their spread matches their errors.

An error is :math:`e = (x - \hat x,\; y - \hat y,\; \mathrm{wrap}(\theta - \hat\theta))`, in metres and radians in the
axes of the map; covariances are in the same coordinates. For a Gaussian posterior

.. math:: \mathrm{NEES} = e^\top \Sigma^{-1} e \sim \chi^2_d

(normalized estimation error squared; Bar-Shalom, Li & Kirubarajan, "Estimation with Applications to Tracking and
Navigation", 2001, section 5.4). A mean above d indicates an overconfident filter. The sum of n independent NEES is
:math:`\chi^2_{nd}`, which gives the interval in which the mean should lie. The frames of one drive are **not**
independent: the number of drives may be given in place of theirs.

The density of the true pose under weighted particles is a kernel density estimate,

.. math:: p(x) = (1 - \epsilon) \sum_i w_i\, \mathcal N\big(t - t_i;\, 0, h_t^2 I\big)\,
   \frac{e^{\kappa \cos(\theta - \theta_i)}}{2\pi I_0(\kappa)} + \epsilon\, u, \qquad \kappa = h_\theta^{-2}

per m² rad (per m² or m without heading), in which a von Mises kernel keeps the heading periodic. Where a filter is
lost, the truth lies so far from all particles that its density is zero apart from the tail of the kernel, and the mean
would depend on the bandwidth alone. The uniform density :math:`u` of the map, with a small share :math:`\epsilon`,
bounds it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats
from scipy.special import i0e, logsumexp

#: Nominal levels at which coverage is reported.
LEVELS = (0.5, 0.9, 0.95)
#: Coordinates of a pose: x, y, heading. A railway has x only, and positions without heading have x and y.
PLANE, POSITION, RAILWAY = (0, 1, 2), (0, 1), (0,)


@dataclass(frozen=True)
class PosteriorCalibration:
    """How errors compare with the covariances reported with them.

    Attributes:
        dof: degrees of freedom, which the mean NEES should equal.
        mean, median: mean and median of the NEES.
        low, high: interval in which the mean of calibrated posteriors lies.
        coverage: by nominal level, the share of the NEES below the quantile of the chi-square distribution.
        poses: number of poses.
    """

    dof: int
    mean: float
    median: float
    low: float
    high: float
    coverage: Mapping[float, float]
    poses: int


def pose_errors(truth: Float[ndarray, "*n 3"], estimate: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
    """Truth minus estimate in metres and radians, the heading in [-π, π).

    >>> truth, estimate = np.array([2.0, 1.0, np.radians(179)]), np.array([1.5, 1.0, np.radians(-179)])
    >>> pose_errors(truth, estimate).round(3)  # the headings are 2° apart
    array([ 0.5  ,  0.   , -0.035])
    """
    difference = truth - estimate
    difference[..., 2] = (difference[..., 2] + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(difference)


def nees(
    truth: Float[ndarray, "*n 3"],
    mean: Float[ndarray, "*n 3"],
    covariance: Float[ndarray, "*n 3 3"],
    axes: tuple[int, ...] = PLANE,
) -> Float[ndarray, "*n"]:
    """Normalized estimation error squared of each pose; inf where an error lies in a direction of zero variance.

    Args:
        truth, mean: poses: x and y in metres, heading in radians.
        covariance: symmetric, in metres and radians.
        axes: coordinates that count: ``PLANE``, ``POSITION`` or ``RAILWAY``.

    >>> off = np.array([1.0, 0.0, 0.0])  # by a metre along x, where sigma is half a metre: 2² for one coordinate
    >>> float(nees(off, np.zeros(3), np.diag([0.25, 1.0, 1.0])))
    4.0
    """
    errors = pose_errors(truth, mean)[..., axes]
    chosen = covariance[..., axes, :][..., axes]
    # metres and radians are normalised first, so that what counts as no variance does not depend on the units
    scale = np.sqrt(np.maximum(np.diagonal(chosen, axis1=-2, axis2=-1), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    variances, directions = np.linalg.eigh(chosen / unit[..., :, None] / unit[..., None, :])
    along = np.einsum("...ji,...j->...i", directions, errors / unit)
    with np.errstate(divide="ignore"):
        terms = np.where(variances > 1e-12, along**2 / np.maximum(variances, 1e-12), np.where(along**2 > 0, np.inf, 0))
    return np.asarray(terms.sum(axis=-1))


def posterior_calibration(
    values: Float[ndarray, " n"], dof: int, *, independent: int | None = None, confidence: float = 0.95
) -> PosteriorCalibration:
    """Mean, interval and coverage of NEES values.

    Args:
        values: results of `nees`.
        dof: number of coordinates in the NEES.
        independent: number of independent values, such as the number of drives; by default all.
        confidence: confidence level of the interval.

    Raises:
        ValueError: there is no value, or one is nan.

    >>> right = np.random.default_rng(0).chisquare(3, 1000)  # NEES of a calibrated filter
    >>> for values in (right, 2 * right):
    ...     found = posterior_calibration(values, dof=3)
    ...     print(found.low <= found.mean <= found.high)
    True
    False
    """
    if len(values) == 0 or np.isnan(values).any():
        raise ValueError(f"calibration needs NEES values without nan, got {len(values)}")
    count = len(values) if independent is None else independent
    tail = (1 - confidence) / 2
    low, high = stats.chi2.ppf([tail, 1 - tail], count * dof) / count
    coverage = {level: float((values <= stats.chi2.ppf(level, dof)).mean()) for level in LEVELS}
    return PosteriorCalibration(
        dof,
        float(values.mean()),
        float(np.median(values)),
        float(low),
        float(high),
        MappingProxyType(coverage),
        len(values),
    )


def particle_nll(
    truth: Float[ndarray, "*n 3"],
    poses: Float[ndarray, "*n p 3"],
    log_weights: Float[ndarray, "*n p"],
    *,
    bandwidth_m: float,
    bandwidth_rad: float,
    axes: tuple[int, ...] = PLANE,
    background: float = 0.0,
    background_density: float = 0.0,
) -> Float[ndarray, "*n"]:
    """Negative log density of the true pose under a kernel density of the particles, in nats; see the module.

    Args:
        truth: true poses: x and y in metres, heading in radians.
        poses: poses of the particles.
        log_weights: log weights up to a constant.
        bandwidth_m: standard deviation of the kernel along each axis.
        bandwidth_rad: bandwidth in heading; the von Mises kernel has concentration ``1 / bandwidth_rad²``.
        axes: coordinates that count: ``PLANE``, ``POSITION`` or ``RAILWAY``.
        background: share of the uniform density, in [0, 1).
        background_density: density of a pose anywhere in the map, such as 1 / (area x 2π) in the plane.

    Raises:
        ValueError: a bandwidth is not positive, the background is outside [0, 1), or its density is not positive.

    >>> one = {"poses": np.zeros((1, 3)), "log_weights": np.zeros(1), "bandwidth_m": 1.0, "bandwidth_rad": 0.1}
    >>> there, away = (particle_nll(np.array([x, 0.0, 0.0]), **one, axes=POSITION) for x in (0.0, 2.0))
    >>> float(there.round(3)), float((away - there).round(3))  # ln 2π, and 2² / 2 more at two bandwidths
    (1.838, 2.0)
    """
    if not (bandwidth_m > 0 and bandwidth_rad > 0):
        raise ValueError(f"bandwidths must be positive, got {bandwidth_m} m and {bandwidth_rad} rad")
    if not 0 <= background < 1 or (background > 0 and background_density <= 0):
        raise ValueError(f"background={background} must be in [0, 1), and its density positive")
    errors = pose_errors(np.broadcast_to(truth[..., None, :], poses.shape), poses)
    linear = [axis for axis in axes if axis != 2]
    scaled = errors[..., linear] / bandwidth_m
    density = -(scaled**2).sum(axis=-1) / 2 - len(linear) * np.log(np.sqrt(2 * np.pi) * bandwidth_m)
    if 2 in axes:
        concentration = bandwidth_rad**-2
        density = density + concentration * (np.cos(errors[..., 2]) - 1) - np.log(2 * np.pi * i0e(concentration))
    weights = log_weights - logsumexp(log_weights, axis=-1, keepdims=True)
    density = logsumexp(weights + density, axis=-1)
    if background > 0:
        density = np.logaddexp(np.log1p(-background) + density, np.log(background * background_density))
    return np.asarray(-density)
