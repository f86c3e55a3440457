r"""What is known of a camera, as robust residuals that one least-squares problem takes together.

A camera is the vector :math:`x = (\theta, \psi, \alpha, \log f, \hat k_1)` of
:mod:`~sextant.baselines.calibration.manhattan`, f and :math:`\hat k_1` in image heights. A term gives residuals
:math:`r(x)` in standard deviations and a loss :math:`\rho(r^2)`; the cost of a camera is half the sum of all losses, a
negative log posterior. No loss but that of what is certain grows as fast as a normal's: Student's

.. math:: \rho(s) = (\nu + 1) \log(1 + s / \nu)

lets a source of evidence that contradicts all others be outvoted, and a mixture of two normals has two opinions at
once. So a term never spoils what the others agree on, as it would in a product of normals.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.baselines.calibration.lens import apparent_k2, undistort_points
from sextant.baselines.calibration.plumb_line import bends
from sextant.errors import ArgumentError

Vectors = Float64[ndarray, "b 5"]


class Term(ABC):
    """One source of evidence.

    Attributes:
        certainty: by which its part of the curvature counts towards the covariance, where its errors are known to be
            larger than its residuals say.
    """

    certainty: float = 1.0

    @abstractmethod
    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b m"]:
        """Residuals of several cameras, in standard deviations."""

    @abstractmethod
    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """The loss of squared residuals with its first and second derivatives."""

    def cost(self, vectors: Vectors) -> Float64[ndarray, "b"]:
        """Half the sum of the losses of several cameras."""
        return np.asarray(0.5 * self.loss(np.square(self.residuals(vectors)))[0].sum(-1))


def student(squares: Float64[ndarray, "*b m"], nu: float) -> Float64[ndarray, "3 *b m"]:
    """Student's loss with ``nu`` degrees of freedom; infinity is the normal's."""
    if math.isinf(nu):
        return np.stack([squares, np.ones_like(squares), np.zeros_like(squares)])
    return np.stack([
        (nu + 1) * np.log1p(squares / nu), (nu + 1) / (nu + squares), -(nu + 1) / np.square(nu + squares),
    ])  # fmt: skip


@dataclass(frozen=True)
class CameraBelief(Term):
    """A camera that somebody names, with standard errors: a network, EXIF, an accelerometer, other photos.

    The horizon is compared as the camera itself places it in the picture, so that a focal length that turns out another
    turns the tilt with it.

    Attributes:
        tilt, roll: radians.
        focal: heights of the part that was seen.
        k1_hat: apparent distortion ``k1 / focal²``.
        sigma: of tilt, roll, vertical field of view (radians) and k1_hat; infinite for what is not known.
        nu: degrees of freedom of the loss.
        zoom: heights of the photo that the part is high.

    Raises:
        UserError: a value is not finite, or the focal length or a standard error is not above 0.
    """

    tilt: float
    roll: float
    focal: float
    k1_hat: float
    sigma: tuple[float, float, float, float]
    nu: float = 3.0
    zoom: float = 1.0

    def __post_init__(self) -> None:
        values = (self.tilt, self.roll, self.focal, self.k1_hat)
        if not (all(map(math.isfinite, values)) and all(value > 0 for value in (self.focal, *self.sigma))):
            raise ArgumentError(
                f"a belief about a camera needs finite values, focal > 0 and sigma > 0; got {self}",
                "For example CameraBelief(0.0, 0.0, 0.9, 0.0, sigma=(0.1, 0.05, 0.2, 0.1)).",
            )

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b 4"]:
        """Of tilt, roll, vertical field of view and k1_hat."""
        focal = np.exp(vectors[:, 3]) / self.zoom
        vfov, said = 2 * np.arctan(0.5 / focal), 2 * math.atan(0.5 / self.focal)
        off = np.stack([
            vectors[:, 0] - self.tilt, vectors[:, 1] - self.roll, vfov - said,
            vectors[:, 4] * self.zoom**2 - self.k1_hat,
        ], axis=1)  # fmt: skip
        return np.asarray(off / np.array(self.sigma))

    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """Student's."""
        return student(squares, self.nu)


@dataclass(frozen=True)
class FocalBelief(Term):
    """A focal length that somebody names: EXIF, or the user.

    Attributes:
        focal: image heights.
        sigma: standard deviation of its logarithm.
        nu: degrees of freedom of the loss.
    """

    focal: float
    sigma: float
    nu: float = 2.0

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b 1"]:
        """Of the log of the focal length."""
        return (vectors[:, 3:4] - math.log(self.focal)) / self.sigma

    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """Student's."""
        return student(squares, self.nu)


@dataclass(frozen=True)
class PhotoPrior(Term):
    """What people's cameras are before the photo is seen: held about level, of common lenses, mostly undistorted.

    Chosen by hand to be wide: lenses of 16 to 70 mm (35-mm equivalent) are within two standard deviations, and beyond
    the tails are Student's. Distortion is a mixture of a maker's or program's undistorted picture and of a lens that
    was left as it is.

    Attributes:
        longer: longer side of the photo, image heights: focal lengths and distortion are compared in longer sides.
        sigma: standard deviations of tilt and roll, and of the log of the focal length.
        nu: degrees of freedom of these three.
        focal: median, longer sides.
        straight: share of undistorted pictures, and the standard deviation of their k1 / f².
        bent: mean and standard deviation of k1 / f² of the others.
    """

    longer: float
    sigma: tuple[float, float, float] = (0.3, 0.06, 0.35)
    nu: tuple[float, float, float] = (3.0, 2.0, 4.0)
    focal: float = 0.95
    straight: tuple[float, float] = (0.4, 0.04)
    bent: tuple[float, float] = (-0.15, 0.25)

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b 4"]:
        """Of tilt, roll and log focal, and the root of twice the cost of k1_hat."""
        named = (vectors[:, [0, 1, 3]] - [0.0, 0.0, math.log(self.focal * self.longer)]) / np.array(self.sigma)
        share, sigma = self.straight
        k1_hat = vectors[:, 4] * self.longer**2
        first = math.log(share / sigma) - 0.5 * np.square(k1_hat / sigma)
        second = math.log((1 - share) / self.bent[1]) - 0.5 * np.square((k1_hat - self.bent[0]) / self.bent[1])
        most = math.log(share / sigma + (1 - share) / self.bent[1])
        cost = np.sqrt(np.maximum(2 * (most - np.logaddexp(first, second)), 0))
        return np.concatenate([named, cost[:, None]], axis=1)

    def loss(self, squares: Float64[ndarray, "*b 4"]) -> Float64[ndarray, "3 *b 4"]:
        """Student's; the last is a cost already."""
        parts = [student(squares[..., i : i + 1], nu) for i, nu in enumerate((*self.nu, math.inf))]
        return np.concatenate(parts, axis=-1)


#: as how many independent measurements all bent chains together count at most, and the longest that take part
CHAINS, MOST_CHAINS = 30.0, 40
#: deviation of a chain of straight lines, in image heights
CHAIN_NOISE = 0.00025


class StraightChains(Term):
    """Chains of edge pixels are straight once the lens is undone.

    Args:
        chains: points in image heights from the centre.
    """

    def __init__(self, chains: Float64[ndarray, "n points 2"]):
        extent = np.linalg.norm(chains[:, -1] - chains[:, 0], axis=-1)
        self.chains = chains[np.argsort(-extent, kind="stable")[:MOST_CHAINS]]
        self.share = min(1.0, CHAINS / max(len(chains), 1))

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b m"]:
        """Bow and S of each chain, one half of the residuals after the other."""
        k1_hat, focal = vectors[:, 4, None, None], np.exp(vectors[:, 3, None, None])
        points = undistort_points(self.chains[None], k1_hat, apparent_k2(k1_hat, focal))
        return np.concatenate(bends(self.chains, points), axis=1) / CHAIN_NOISE

    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """Cauchy's of each chain's bow and S together: curves of the world count little."""
        half = squares.shape[-1] // 2
        more = 1 + squares[..., :half] + squares[..., half:]
        rho = self.share * np.stack([np.log(more) / 2, 1 / more, -1 / np.square(more)])
        return np.concatenate([rho, rho], axis=-1)
