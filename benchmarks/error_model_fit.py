r"""Fit the model of errors of joint cameras, and the threshold of *good*, to photos with known cameras.

The numbers :math:`(a, b, w, \log \nu, \log \tau)` of :mod:`~sextant.chapters.calibration.error_model` maximise the
posterior under weak priors. The integral over each source's :math:`u_j` is by Gauss-Hermite quadrature, and the log
densities of n photos of a source are divided by the root of n, as their errors are not independent.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.special import digamma, gammaln, logsumexp

from sextant.chapters.calibration.error_model import COVARIATES, LEAST, LOG_WEIGHTS, NODES, ErrorModel, log_scales

#: means and standard deviations of the priors of a, b, each w, log nu and log tau
PRIORS = np.array([(0.0, 2.0), (1.0, 0.5), *((0.0, 0.5),) * len(COVARIATES), (math.log(4), 0.5), (math.log(0.3), 0.5)])


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


def _log_student(
    vector: Float64[ndarray, "p"],
    errors: Float64[ndarray, "n"],
    sigma: Float64[ndarray, "n"],
    covariates: Float64[ndarray, "n k"],
) -> Float64[ndarray, "n nodes"]:
    """Log densities given each node of u."""
    nu, scales = np.exp(vector[-2]), _log_scales(vector, sigma, covariates)
    norm = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
    squares = np.square(errors)[:, None] * np.exp(-2 * scales)
    return np.asarray(norm - scales - (nu + 1) / 2 * np.log1p(squares / nu))


def _slopes(
    vector: Float64[ndarray, "p"],
    errors: Float64[ndarray, "n"],
    sigma: Float64[ndarray, "n"],
    covariates: Float64[ndarray, "n k"],
) -> Float64[ndarray, "p n nodes"]:
    """Derivatives of :func:`_log_student` by the fitted numbers."""
    nu, spread = np.exp(vector[-2:])
    squares = np.square(errors)[:, None] * np.exp(-2 * _log_scales(vector, sigma, covariates))
    by_scale = (nu + 1) * squares / (nu + squares) - 1
    by_nu = 0.5 * (digamma((nu + 1) / 2) - digamma(nu / 2) - 1 / nu - np.log1p(squares / nu)) + (
        nu + 1
    ) / 2 * squares / (nu * (nu + squares))
    columns = np.column_stack([np.ones(len(errors)), np.log(np.maximum(sigma, LEAST)), covariates]).T
    return np.concatenate([columns[:, :, None] * by_scale, [nu * by_nu, by_scale * spread * NODES]])


def _log_scales(
    vector: Float64[ndarray, "p"], sigma: Float64[ndarray, "n"], covariates: Float64[ndarray, "n k"]
) -> Float64[ndarray, "n nodes"]:
    return log_scales(vector[0], vector[1], vector[2:-2], np.exp(vector[-1]), sigma, covariates)


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
