r"""How far off a joint camera is: a hierarchical model of its errors, fitted to photos with known cameras.

The error of a number - tilt, roll or log focal length - has Student's t distribution about zero, with the scale

.. math:: \log s = a + b \log \sigma + w^\top z + u_j, \qquad u_j \sim N(0, \tau^2),

where :math:`\sigma` is the standard error from the curvature of the joint cost, z what else tells of the error
(:data:`COVARIATES`), and :math:`u_j` is shared by all photos of the source j. The nine numbers
:math:`(a, b, w, \log \nu, \log \tau)` maximise the posterior under weak priors. The integral over :math:`u_j` is by
Gauss-Hermite quadrature, and the log densities of n photos of a source are divided by the root of n, as their errors
are not independent. A new photo is of an unknown source: its error is a mixture over u.

Sources: A. Gelman et al., "Bayesian Data Analysis", 3rd edition, 2013, chapter 5, for hierarchical models; K. L. Lange,
R. J. A. Little, J. M. G. Taylor, JASA 1989, for Student's t.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.special import digamma, gammaln, logsumexp, stdtr

#: what z consists of, with the centre and spread that each is standardised by: the share of segments' length that a
#: frame explains, log(1 + long segments along the second axis), log(1 + standard errors between network and joint
#: camera), the log of the network's own standard error (radians), and log(0.02 + |k1 / f²|), f in longer sides
COVARIATES = {
    "explained": (0.5, 0.2),
    "support": (2.5, 1.0),
    "disagreement": (0.7, 0.5),
    "network": (-2.5, 0.5),
    "distortion": (-2.5, 0.8),
}
#: means and standard deviations of the priors of a, b, each w, log nu and log tau
PRIORS = np.array([(0.0, 2.0), (1.0, 0.5), *((0.0, 0.5),) * len(COVARIATES), (math.log(4), 0.5), (math.log(0.3), 0.5)])
#: nodes of the quadrature over u, in standard deviations, and their weights
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
LOG_WEIGHTS = np.log(WEIGHTS / WEIGHTS.sum())
#: least standard error, that its logarithm is finite
LEAST = 1e-6


@dataclass(frozen=True)
class ErrorModel:
    """The fitted numbers of one of tilt, roll (radians) and log focal length.

    Attributes:
        offset, slope: a and b.
        weights: w, of each of :data:`COVARIATES`.
        nu: degrees of freedom.
        spread: tau, the standard deviation of the log scale between sources.

    Example:
        >>> model = ErrorModel(offset=0.0, slope=1.0, weights=(0.0,) * 5, nu=3.0, spread=1e-9)
        >>> sigma, usual = np.array([0.1, 1.0]), np.zeros((2, 5))
        >>> model.within(0.1, sigma, usual).round(2).tolist()  # Student's t within 1 and within 0.1 of its scale
        [0.61, 0.07]
    """

    offset: float
    slope: float
    weights: tuple[float, ...]
    nu: float
    spread: float

    def within(
        self, limit: float, sigma: Float64[ndarray, "n"], covariates: Float64[ndarray, "n k"]
    ) -> Float64[ndarray, "n"]:
        """Probability that the error of a photo of an unknown source is at most ``limit``; 0 where sigma is infinite.

        Args:
            limit: in the units of sigma.
            sigma: standard errors from the curvature.
            covariates: standardised by :func:`standardised`.
        """
        known = np.isfinite(sigma) & np.isfinite(covariates).all(axis=1)
        log_scale = _log_scale(self._vector(), np.where(known, sigma, 1.0), np.where(known[:, None], covariates, 0.0))
        inside = 2 * stdtr(self.nu, limit / np.exp(log_scale[:, None] + self.spread * NODES)) - 1
        return np.where(known, inside @ np.exp(LOG_WEIGHTS), 0.0)

    def log_density(
        self, errors: Float64[ndarray, "n"], sigma: Float64[ndarray, "n"], covariates: Float64[ndarray, "n k"]
    ) -> Float64[ndarray, "n"]:
        """Log density of errors of photos of unknown sources."""
        each = _log_student(self._vector(), errors, sigma, covariates)
        return np.asarray(logsumexp(each + LOG_WEIGHTS, axis=1))

    def row(self) -> dict[str, Any]:
        """The fitted numbers by name."""
        return {**vars(self), "weights": dict(zip(COVARIATES, self.weights, strict=True))}

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> "ErrorModel":
        """The model of :meth:`row`."""
        weights = tuple(float(row["weights"][name]) for name in COVARIATES)
        return cls(float(row["offset"]), float(row["slope"]), weights, float(row["nu"]), float(row["spread"]))

    def _vector(self) -> Float64[ndarray, "p"]:
        return np.array([self.offset, self.slope, *self.weights, math.log(self.nu), math.log(self.spread)])


def standardised(values: Mapping[str, Float64[ndarray, "n"]]) -> Float64[ndarray, "n k"]:
    """The covariates as columns, in spreads from their centres."""
    return np.stack([(values[name] - centre) / spread for name, (centre, spread) in COVARIATES.items()], axis=1)


def fit_error_model(
    errors: Float64[ndarray, "n"],
    sigma: Float64[ndarray, "n"],
    covariates: Float64[ndarray, "n k"],
    sources: Sequence[str],
) -> ErrorModel:
    """The most probable model given errors with their sources; errors that are nan are left out.

    Raises:
        ValueError: no error is known.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> errors = 0.2 * rng.standard_t(4, 2000)  # twice what the curvature says
        >>> model = fit_error_model(errors, np.full(2000, 0.1), np.zeros((2000, 5)), [str(i % 40) for i in range(2000)])
        >>> 0.8 < float(model.within(0.2, np.array([0.1]), np.zeros((1, 5)))[0]) / 0.626 < 1.2
        True
    """
    from scipy.optimize import minimize

    known = np.isfinite(errors) & np.isfinite(sigma)
    if not known.any():
        raise ValueError("no error is known")
    _, owner, counts = np.unique(np.array(sources, dtype=str)[known], return_inverse=True, return_counts=True)
    order = np.argsort(owner, kind="stable")
    errors, sigma, covariates, owner = errors[known][order], sigma[known][order], covariates[known][order], owner[order]
    starts, share = np.concatenate([[0], np.cumsum(counts)[:-1]]), counts[owner] ** -0.5

    def cost(vector: Float64[ndarray, "p"]) -> tuple[float, Float64[ndarray, "p"]]:
        each = np.add.reduceat(share[:, None] * _log_student(vector, errors, sigma, covariates), starts) + LOG_WEIGHTS
        evidence = logsumexp(each, axis=1, keepdims=True)
        posterior = share[:, None] * np.exp(each - evidence)[owner]  # of each node, given the source's photos
        slopes = _slopes(vector, errors, sigma, covariates)
        off = (vector - PRIORS[:, 0]) / PRIORS[:, 1]
        gradient = off / PRIORS[:, 1] - np.einsum("nk,pnk->p", posterior, slopes)
        return float(0.5 * np.square(off).sum() - evidence.sum()), gradient

    found = minimize(cost, PRIORS[:, 0], jac=True, method="L-BFGS-B").x.tolist()
    offset, slope, *weights, log_nu, log_spread = found
    return ErrorModel(offset, slope, tuple(weights), math.exp(log_nu), math.exp(log_spread))


def _log_scale(
    vector: Float64[ndarray, "p"], sigma: Float64[ndarray, "n"], covariates: Float64[ndarray, "n k"]
) -> Float64[ndarray, "n"]:
    return np.asarray(vector[0] + vector[1] * np.log(np.maximum(sigma, LEAST)) + covariates @ vector[2:-2])


def _log_student(
    vector: Float64[ndarray, "p"],
    errors: Float64[ndarray, "n"],
    sigma: Float64[ndarray, "n"],
    covariates: Float64[ndarray, "n k"],
) -> Float64[ndarray, "n nodes"]:
    """Log densities given each node of u."""
    nu, spread = np.exp(vector[-2:])
    log_scale = _log_scale(vector, sigma, covariates)[:, None] + spread * NODES
    norm = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
    squares = np.square(errors)[:, None] * np.exp(-2 * log_scale)
    return np.asarray(norm - log_scale - (nu + 1) / 2 * np.log1p(squares / nu))


def _slopes(
    vector: Float64[ndarray, "p"],
    errors: Float64[ndarray, "n"],
    sigma: Float64[ndarray, "n"],
    covariates: Float64[ndarray, "n k"],
) -> Float64[ndarray, "p n nodes"]:
    """Derivatives of :func:`_log_student` by the fitted numbers."""
    nu, spread = np.exp(vector[-2:])
    log_scale = _log_scale(vector, sigma, covariates)[:, None] + spread * NODES
    squares = np.square(errors)[:, None] * np.exp(-2 * log_scale)
    by_scale = (nu + 1) * squares / (nu + squares) - 1
    by_nu = 0.5 * (digamma((nu + 1) / 2) - digamma(nu / 2) - 1 / nu - np.log1p(squares / nu)) + (
        nu + 1
    ) / 2 * squares / (nu * (nu + squares))
    columns = np.column_stack([np.ones(len(errors)), np.log(np.maximum(sigma, LEAST)), covariates]).T
    return np.concatenate([columns[:, :, None] * by_scale, [nu * by_nu, by_scale * spread * NODES]])


def likely_right(
    probability: Float64[ndarray, "n"], wrong: Bool[ndarray, "n"], most: float, grid: Float64[ndarray, "m"]
) -> float:
    """The smallest threshold above which the mean probability that an answer is wrong is at most ``most``.

    With k of n answers at or above a threshold wrong, that mean under Jeffreys' prior is (k + 1/2) / (n + 1).
    Infinite if no threshold will do.

    >>> sure, wrong = np.linspace(0, 0.99, 100), np.arange(100) < 60  # the less probable ones are wrong
    >>> round(likely_right(sure, wrong, 0.05, np.linspace(0, 1, 101)), 2)
    0.59
    """
    for threshold in grid:
        at = probability >= threshold
        if (wrong[at].sum() + 0.5) / (at.sum() + 1) <= most:
            return float(threshold)
    return math.inf
