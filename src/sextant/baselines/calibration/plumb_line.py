r"""Distortion from bent lines: the lens that makes chains of edge pixels straight.

Along a chain of n evenly spaced points let :math:`c_k = \sum_i q_k(i) p_i` with orthonormal polynomials :math:`q_k` of
degree k. Then :math:`c_1` has its direction and extent :math:`L = |c_1|`, and the parts of :math:`c_2, c_3` across that
are its bow and its S: both are 0 for a straight line, and finer wiggles, which are noise, are left out. Undistortion of
a barrel stretches the picture, so lengths are only compared relative to L: the deviation is
:math:`e = L_0 |(c_2, c_3)_\perp| / (L \sqrt n)` with the original extent :math:`L_0`; without this, a lens that shrinks
the picture would have the lowest cost. The posterior of :math:`\hat k_1`, in image heights, is computed on a grid, with
Cauchy noise that down-weights curved edges of the scene, and its peak refined. Straightness does not determine the
focal length; the prior's enters only the tiny term of :func:`~sextant.baselines.calibration.lens.apparent_k2`.

Source of the idea: D. C. Brown, "Close-range camera calibration", 1971; F. Devernay, O. Faugeras, "Straight lines have
to be straight", MVA 2001.
"""

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy import ndarray

from sextant.baselines.calibration.edge_chains import detect_chains
from sextant.baselines.calibration.estimate import CalibrationBaseline, CalibrationEstimate, CameraPrior
from sextant.baselines.calibration.lens import apparent_k2, undistort_points

#: Grid of values of k1_hat.
GRID = np.linspace(-1.8, 0.4, 56)
#: Standard deviation from straightness of chains on straight lines, in image heights.
NOISE = 0.00025
#: Independent measurements that one chain is worth, and the most that all chains together are worth.
PER_CHAIN, AT_MOST = 1.0, 15.0
#: Sevenfold refinements of the grid about its best value; the smallest standard deviation returned.
ROUNDS, SMALLEST_SIGMA = 2, 1e-6
#: Number of longest chains used.
MOST_CHAINS = 100


class PlumbLine(CalibrationBaseline):
    """Distortion from the straightness of edges; tilt, roll and focal length are the prior's.

    Args:
        prior: belief about the camera; ``fit`` replaces it.

    Example:
        >>> v, u = (np.mgrid[:256, :256] + 0.5) / 256 - 0.5
        >>> x = undistort_points(np.stack([u, v], axis=-1), -0.3, apparent_k2(-0.3, 1.0))[..., 0]
        >>> stripes = np.uint8(127.5 + 127.5 * np.sin(40 * x))[..., None].repeat(3, axis=-1)  # bent by k1 = -0.3
        >>> estimate = PlumbLine(CameraPrior(focal=1.0)).calibrate(stripes)
        >>> round(float(estimate.camera.k1), 1), estimate.determined
        (-0.3, Determined(tilt=False, roll=False, focal=False, k1=True))
    """

    def calibrate(self, image: UInt8[ndarray, "h w 3"]) -> CalibrationEstimate:
        """The camera that took ``image``: the prior's, except for k1."""
        chains = detect_chains(image)
        k1_hat, sigma = straightening_k1_hat(chains, self.prior_)
        vector, spread = self.prior_.vector, np.array(self.prior_.sigma)
        vector[3], spread[3] = k1_hat, sigma
        return CalibrationEstimate.of_vector(vector, np.diag(spread**2), self.prior_, len(chains))


def straightening_k1_hat(chains: Float64[ndarray, "n points 2"], prior: CameraPrior) -> tuple[float, float]:
    """Most probable ``k1_hat`` and its standard deviation, given chains (image heights) and the prior.

    Without chains, these are the prior's own.
    """
    if len(chains) == 0:
        return prior.k1_hat, prior.sigma[3]
    extent = np.linalg.norm(chains[:, -1] - chains[:, 0], axis=-1)
    chains = chains[np.argsort(-extent, kind="stable")[:MOST_CHAINS]]
    tried = np.union1d(GRID, prior.k1_hat + prior.sigma[3] * np.linspace(-3, 3, 25))  # the prior may be narrow
    cost = _negative_log_posterior(tried, chains, prior)
    for _ in range(ROUNDS):
        best = int(cost.argmin())
        finer = np.linspace(tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)], 15)
        tried, cost = _merged(tried, cost, finer, _negative_log_posterior(finer, chains, prior))
    peak = float(tried[cost.argmin()])
    return peak, max(_spread(tried, cost, peak), SMALLEST_SIGMA)


def deviations(
    chains: Float64[ndarray, "n points 2"], k1_hat: Float64[ndarray, "a"], focal: float
) -> Float64[ndarray, "a n"]:
    """Deviation of each chain from straightness for each lens, relative to its extent there; in image heights."""
    k1_hat = k1_hat[:, None, None]
    return np.asarray(np.hypot(*bends(chains, undistort_points(chains[None], k1_hat, apparent_k2(k1_hat, focal)))))


def bends(
    chains: Float64[ndarray, "n points 2"], undone: Float64[ndarray, "a n points 2"]
) -> tuple[Float64[ndarray, "a n"], Float64[ndarray, "a n"]]:
    """Signed bow and S of undistorted chains, scaled to the original chains' image heights."""
    extent = np.linalg.norm(_polynomials(chains[None])[0, :, 0], axis=-1)
    line, second, third = np.moveaxis(_polynomials(undone), 2, 0)
    scale = extent / np.square(line).sum(-1) / np.sqrt(chains.shape[1])
    return _across(line, second) * scale, _across(line, third) * scale


def _across(line: Float64[ndarray, "a n 2"], bend: Float64[ndarray, "a n 2"]) -> Float64[ndarray, "a n"]:
    return np.asarray(line[..., 0] * bend[..., 1] - line[..., 1] * bend[..., 0])


def _polynomials(points: Float64[ndarray, "a n points 2"]) -> Float64[ndarray, "a n 3 2"]:
    """Coefficients of degree 1 to 3 along chains, in an orthonormal basis."""
    index = np.linspace(-1, 1, points.shape[2])
    basis, _ = np.linalg.qr(np.vander(index, 4, increasing=True))
    return np.asarray(np.einsum("anpd,pk->ankd", points, basis[:, 1:]))


def _negative_log_posterior(
    k1_hat: Float64[ndarray, "a"], chains: Float64[ndarray, "n points 2"], prior: CameraPrior
) -> Float64[ndarray, "a"]:
    excess = np.square(deviations(chains, k1_hat, prior.focal) / NOISE)
    weight = 0.5 * min(PER_CHAIN, AT_MOST / len(chains))
    belief = 0.5 * np.square((k1_hat - prior.k1_hat) / prior.sigma[3])
    return np.asarray(weight * np.log1p(excess).sum(axis=1) + belief)


def _merged(
    values: Float[ndarray, "a"], cost: Float[ndarray, "a"], more: Float[ndarray, "b"], more_cost: Float[ndarray, "b"]
) -> tuple[Float[ndarray, "c"], Float[ndarray, "c"]]:
    together, index = np.unique(np.concatenate([values, more]), return_index=True)
    return together, np.concatenate([cost, more_cost])[index]


def _spread(values: Float[ndarray, "a"], cost: Float[ndarray, "a"], peak: float) -> float:
    """Root mean square distance from the peak under the posterior, other modes included."""
    mass = np.exp(cost.min() - cost) * np.gradient(values)
    return float(np.sqrt((mass * (values - peak) ** 2).sum() / mass.sum()))
