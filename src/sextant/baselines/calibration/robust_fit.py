r"""Robust least squares over some of the five numbers of a camera: :math:`\tfrac12 \sum_i \rho_i(r_i^2)`."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray
from scipy.optimize import least_squares

from sextant.baselines.calibration.terms import Term

#: shortest and longest focal length of the search, in image heights; 60 are 40 longer sides of 3:2, or 1,400 mm
FOCAL_HEIGHTS = (0.15, 60.0)
#: bounds of tilt, roll, heading, log focal and k1_hat
LOW = np.array([-1.5, -np.pi / 4, -np.inf, np.log(FOCAL_HEIGHTS[0]), -2.5])
HIGH = np.array([1.5, np.pi / 4, np.inf, np.log(FOCAL_HEIGHTS[1]), 1.0])
DIFFERENCE = 1e-6


class RobustFit:
    """Terms of evidence, stacked one after the other, over the ``free`` numbers among the five.

    Args:
        terms: the evidence.
        free: which of tilt, roll, heading, log focal and k1_hat are fitted.
        fixed: all five; the others keep these values.
        tolerance: relative change of cost and numbers below which the search ends.
        evaluations: largest number of evaluations of the residuals.
    """

    def __init__(
        self,
        terms: Sequence[Term],
        free: Int[ndarray, "k"],
        fixed: Float64[ndarray, "5"],
        *,
        tolerance: float,
        evaluations: int,
    ):
        self.terms, self.free, self.fixed = terms, free, fixed
        self.tolerance, self.evaluations = tolerance, evaluations
        self.ends = np.cumsum([0, *(term.residuals(fixed[None]).shape[1] for term in terms)])

    def residuals(self, free: Float64[ndarray, "b k"]) -> Float64[ndarray, "b m"]:
        """Residuals for several values of the free numbers."""
        vectors = np.repeat(self.fixed[None], len(free), axis=0)
        vectors[:, self.free] = free
        return np.concatenate([term.residuals(vectors) for term in self.terms], axis=1)

    def loss(self, squares: Float64[ndarray, "m"]) -> Float64[ndarray, "3 m"]:
        """Each loss of squared residuals, with its first and second derivative."""
        parts = zip(self.terms, self.ends[:-1], self.ends[1:], strict=True)
        return np.concatenate([term.loss(squares[first:last]) for term, first, last in parts], axis=-1)

    def jacobian(self, free: Float64[ndarray, "k"]) -> Float64[ndarray, "m k"]:
        """Jacobian of the residuals by central differences, all at once."""
        step = DIFFERENCE * np.eye(len(free))
        plus, minus = np.split(self.residuals(np.concatenate([free + step, free - step])), 2)
        return np.asarray((plus - minus).T / (2 * DIFFERENCE))

    def solve(self, start: Float64[ndarray, "5"]) -> Float64[ndarray, "5"]:
        """All five numbers at the minimum near ``start``."""
        solution = least_squares(
            lambda free: self.residuals(free[None])[0],
            start[self.free],
            self.jacobian,
            bounds=(LOW[self.free], HIGH[self.free]),
            loss=self.loss,
            x_scale=0.1,
            ftol=self.tolerance,
            xtol=self.tolerance,
            gtol=self.tolerance,
            max_nfev=self.evaluations,
        )
        vector = self.fixed.copy()
        vector[self.free] = solution.x
        return vector

    def cost(self, vector: Float64[ndarray, "5"]) -> float:
        """Half the sum of all losses."""
        return float(0.5 * self.loss(np.square(self.residuals(vector[None, self.free])[0]))[0].sum())

    def information(self, vector: Float64[ndarray, "5"]) -> Float64[ndarray, "5 5"]:
        """Curvature of the cost, with the certainty of each term; 0 for numbers that are not free."""
        free = vector[self.free]
        certainty = np.repeat([term.certainty for term in self.terms], np.diff(self.ends))
        weights = certainty * self.loss(np.square(self.residuals(free[None])[0]))[1]
        jacobian = self.jacobian(free)
        information = np.zeros((5, 5))
        information[np.ix_(self.free, self.free)] = (jacobian * weights[:, None]).T @ jacobian
        return information
