r"""How far off a joint camera is: a hierarchical model of its errors, fitted to photos with known cameras.

The error of a number - tilt, roll or log focal length - has Student's t distribution about zero, with the scale

.. math:: \log s = a + b \log \sigma + w^\top z + u_j, \qquad u_j \sim N(0, \tau^2),

where :math:`\sigma` is the standard error from the curvature of the joint cost, z what else tells of the error
(:data:`COVARIATES`), and :math:`u_j` is shared by all photos of the source j. The nine numbers
:math:`(a, b, w, \log \nu, \log \tau)` are fitted by ``benchmarks.error_model_fit``. A new photo is of an unknown
source: its error is a mixture over u, integrated by Gauss-Hermite quadrature.

Sources: A. Gelman et al., "Bayesian Data Analysis", 3rd edition, 2013, chapter 5, for hierarchical models; K. L. Lange,
R. J. A. Little, J. M. G. Taylor, JASA 1989, for Student's t.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.special import stdtr

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
        sigma, covariates = np.where(known, sigma, 1.0), np.where(known[:, None], covariates, 0.0)
        scale = np.exp(log_scales(self.offset, self.slope, np.array(self.weights), self.spread, sigma, covariates))
        inside = 2 * stdtr(self.nu, limit / scale) - 1
        return np.where(known, inside @ np.exp(LOG_WEIGHTS), 0.0)

    def row(self) -> dict[str, Any]:
        """The fitted numbers by name."""
        return {**vars(self), "weights": dict(zip(COVARIATES, self.weights, strict=True))}

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> "ErrorModel":
        """The model of :meth:`row`."""
        weights = tuple(float(row["weights"][name]) for name in COVARIATES)
        return cls(float(row["offset"]), float(row["slope"]), weights, float(row["nu"]), float(row["spread"]))


def standardised(values: Mapping[str, Float64[ndarray, "n"]]) -> Float64[ndarray, "n k"]:
    """The covariates as columns, in spreads from their centres."""
    return np.stack([(values[name] - centre) / spread for name, (centre, spread) in COVARIATES.items()], axis=1)


def log_scales(
    offset: float,
    slope: float,
    weights: Float64[ndarray, "k"],
    spread: float,
    sigma: Float64[ndarray, "n"],
    covariates: Float64[ndarray, "n k"],
) -> Float64[ndarray, "n nodes"]:
    """The log scale of each error at each of the quadrature's :data:`NODES`, the multiples of tau that u may be."""
    each = offset + slope * np.log(np.maximum(sigma, LEAST)) + covariates @ weights
    return np.asarray(each[:, None] + spread * NODES)
