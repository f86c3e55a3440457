r"""Robust least squares over some of the five numbers of a camera: :math:`\tfrac12 \sum_i \rho_i(r_i^2)`."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray
from scipy.optimize import least_squares

#: shortest and longest focal length of the search, in image heights; 60 are 40 longer sides of 3:2, or 1,400 mm
FOCAL_HEIGHTS = (0.15, 60.0)
#: bounds of tilt, roll, heading, log focal and k1_hat
LOW = np.array([-1.5, -np.pi / 4, -np.inf, np.log(FOCAL_HEIGHTS[0]), -2.5])
HIGH = np.array([1.5, np.pi / 4, np.inf, np.log(FOCAL_HEIGHTS[1]), 1.0])
DIFFERENCE = 1e-6


class RobustFit(ABC):
    """Residuals and their losses over the ``free`` numbers among the five.

    Args:
        free: which of tilt, roll, heading, log focal and k1_hat are fitted.
        fixed: all five; the others keep these values.

    Attributes:
        tolerance: relative change of cost and numbers below which the search ends.
        evaluations: largest number of evaluations of the residuals.
    """

    tolerance: ClassVar[float] = 1e-6
    evaluations: ClassVar[int] = 20

    def __init__(self, free: Int[ndarray, "k"], fixed: Float64[ndarray, "5"]):
        self.free, self.fixed = free, fixed

    @abstractmethod
    def residuals_of(self, vectors: Float64[ndarray, "b 5"]) -> Float64[ndarray, "b m"]:
        """Residuals of several cameras, in standard errors."""

    @abstractmethod
    def loss(self, squares: Float64[ndarray, "m"]) -> Float64[ndarray, "3 m"]:
        """Each loss of squared residuals, with its first and second derivative."""

    def residuals(self, free: Float64[ndarray, "b k"]) -> Float64[ndarray, "b m"]:
        """Residuals for several values of the free numbers."""
        vectors = np.repeat(self.fixed[None], len(free), axis=0)
        vectors[:, self.free] = free
        return self.residuals_of(vectors)

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
