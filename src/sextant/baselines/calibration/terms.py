r"""Evidence about a camera, as robust residuals that one least-squares problem combines.

A camera is the vector :math:`x = (\theta, \psi, \alpha, \log f, \hat k_1)` of
:mod:`~sextant.baselines.calibration.manhattan`, f and :math:`\hat k_1` in image heights. A term gives residuals
:math:`r(x)` in standard deviations and a loss :math:`\rho(r^2)`; the cost of a camera is half the sum of all losses, a
negative log posterior. Only terms for certain values have the quadratic loss of a normal distribution. Student's

.. math:: \rho(s) = (\nu + 1) \log(1 + s / \nu)

down-weights evidence that contradicts all other evidence, and a mixture of two normals represents two hypotheses. So no
term overrides what the others agree on, as it would in a product of normals.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.baselines.calibration.lens import apparent_k2, undistort_points
from sextant.baselines.calibration.plumb_line import NOISE, bends
from sextant.errors import ArgumentError

Vectors = Float64[ndarray, "b 5"]
#: standard deviation of k1_hat below which it is known better than from chains of edges
KNOWN_BEND = 0.01


class Term(ABC):
    """One source of evidence.

    Attributes:
        certainty: factor on its part of the curvature for the covariance, below 1 where its errors are known to be
            larger than its residuals suggest.
    """

    certainty: float = 1.0

    @property
    def lens(self) -> tuple[float, float, float | None] | None:
        """Log focal, its standard deviation, and k1_hat if known as well; None for a term without a lens."""
        return None

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
    """Student's loss with ``nu`` degrees of freedom; for infinity, that of a normal distribution."""
    if math.isinf(nu):
        return np.stack([squares, np.ones_like(squares), np.zeros_like(squares)])
    return np.stack([
        (nu + 1) * np.log1p(squares / nu), (nu + 1) / (nu + squares), -(nu + 1) / np.square(nu + squares),
    ])  # fmt: skip


@dataclass(frozen=True)
class CameraBelief(Term):
    """A camera with standard errors from another source: a network, EXIF, an accelerometer, other photos.

    Parameters are compared independently: a different focal length leaves the believed tilt unchanged.

    Attributes:
        tilt, roll: in radians.
        focal: in heights of the part of the photo that the source used.
        k1_hat: apparent distortion ``k1 / focal²``.
        sigma: standard errors of tilt, roll, vertical field of view (radians) and k1_hat; infinite where not known.
        nu: degrees of freedom of the loss.
        zoom: height of that part, in heights of the photo.

    Raises:
        UserError: a value is not finite, the focal length or a standard error is not above 0, or these are not four.

    Example:
        >>> belief = CameraBelief(tilt=0.1, roll=0.0, focal=0.5, k1_hat=0.0, sigma=(0.1, 0.05, 0.2, 0.1))
        >>> camera = np.array([[0.3, 0.0, 0.0, math.log(0.5), 0.0]])  # tilted by two standard errors more
        >>> (belief.residuals(camera).round(6) + 0.0).tolist()
        [[2.0, 0.0, 0.0, 0.0]]
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
        positive = all(value > 0 for value in (self.focal, *self.sigma))
        if not (all(map(math.isfinite, values)) and positive and len(self.sigma) == 4):
            raise ArgumentError(
                f"a belief about a camera needs finite values, focal > 0 and four sigma > 0; got {self}",
                "For example CameraBelief(0.0, 0.0, 0.9, 0.0, sigma=(0.1, 0.05, 0.2, 0.1)).",
            )

    @property
    def lens(self) -> tuple[float, float, float | None]:
        """The believed lens."""
        per_vfov = (4 * self.focal**2 + 1) / (4 * self.focal)  # |d ln f / d vfov|
        k1_hat = self.k1_hat / self.zoom**2
        known = self.sigma[3] / self.zoom**2 < KNOWN_BEND
        return math.log(self.focal * self.zoom), self.sigma[2] * per_vfov, k1_hat if known else None

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b 4"]:
        """Residuals of tilt, roll, vertical field of view and k1_hat."""
        focal = np.exp(vectors[:, 3]) / self.zoom
        vfov, said = 2 * np.arctan(0.5 / focal), 2 * math.atan(0.5 / self.focal)
        off = np.stack([
            vectors[:, 0] - self.tilt, vectors[:, 1] - self.roll, vfov - said,
            vectors[:, 4] * self.zoom**2 - self.k1_hat,
        ], axis=1)  # fmt: skip
        return np.asarray(off / np.array(self.sigma))

    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """Student's loss."""
        return student(squares, self.nu)


@dataclass(frozen=True)
class FocalBelief(Term):
    """A focal length from EXIF or from the user.

    Attributes:
        focal: in image heights.
        sigma: standard deviation of its logarithm.
        nu: degrees of freedom of the loss.

    Example:
        >>> belief = FocalBelief(focal=1.0, sigma=0.1)
        >>> longer = np.array([[0.0, 0.0, 0.0, 0.1, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0]])  # by 1 and 10 standard deviations
        >>> belief.cost(longer).round(2).tolist()  # a normal's would be 0.5 and 50
        [0.61, 5.9]
    """

    focal: float
    sigma: float
    nu: float = 2.0

    @property
    def lens(self) -> tuple[float, float, None]:
        """The believed focal length."""
        return math.log(self.focal), self.sigma, None

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b 1"]:
        """Residual of the log of the focal length."""
        return (vectors[:, 3:4] - math.log(self.focal)) / self.sigma

    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """Student's loss."""
        return student(squares, self.nu)


@dataclass(frozen=True)
class GravityBelief(Term):
    """The direction of gravity from a source such as an accelerometer.

    Attributes:
        down: unit vector of gravity in the camera frame: right, down and forward.
        sigma: standard deviation per direction, in radians.
        nu: degrees of freedom of the loss.

    Example:
        >>> tilt, roll = GravityBelief(down=(0.0, 0.8, -0.6), sigma=0.01).pose
        >>> round(math.degrees(tilt), 2), roll  # gravity points backwards: the camera looks up
        (36.87, 0.0)
    """

    down: tuple[float, float, float]
    sigma: float
    nu: float = 3.0

    @property
    def pose(self) -> tuple[float, float]:
        """Tilt and roll in radians."""
        right, down, forward = self.down
        return -math.asin(max(-1.0, min(1.0, forward))), math.atan2(right, down)

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b 3"]:
        """Residuals of the three components of gravity."""
        tilt, roll = vectors[:, 0], vectors[:, 1]
        level = np.cos(tilt)
        found = np.stack([level * np.sin(roll), level * np.cos(roll), -np.sin(tilt)], axis=1)
        return np.asarray((found - np.array(self.down)) / self.sigma)

    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """Student's loss."""
        return student(squares, self.nu)


@dataclass(frozen=True)
class PhotoPrior(Term):
    """The image-independent prior on the camera of a photo: about level, common lenses, often undistorted.

    It was chosen by hand to be wide: lenses of 16 to 65 mm (35-mm equivalent) are within two standard deviations, and
    the tails are Student's. The median, 32 mm, lies between those of phones (27 to 30) and of cameras (35 to 38). 31 mm
    has smaller errors on all photos of ``benchmarks.joint_intervals`` together, but larger ones without its phones.
    Distortion is a mixture of pictures undistorted in the camera or by software, and of uncorrected lenses.

    Attributes:
        longer: longer side of the photo in image heights; focal lengths and distortion are compared in longer sides.
        sigma: standard deviations of tilt and roll, and of the log of the focal length.
        nu: degrees of freedom of these three.
        focal: median focal length, in longer sides.
        straight: share of undistorted pictures, and the standard deviation of their k1 / f².
        bent: mean and standard deviation of k1 / f² of the others.

    Example:
        >>> prior = PhotoPrior(longer=1.5)
        >>> camera = np.array([[0.3, 0.06, 0.0, math.log(0.9 * 1.5), 0.0]])  # one standard deviation up and round
        >>> (prior.residuals(camera).round(4) + 0.0).tolist()  # the last: 0.15 / 0.25 from bent pictures
        [[1.0, 1.0, 0.0, 0.0, 0.6]]
    """

    longer: float
    sigma: tuple[float, float, float] = (0.3, 0.06, 0.35)
    nu: tuple[float, float, float] = (3.0, 2.0, 4.0)
    focal: float = 0.9
    straight: tuple[float, float] = (0.4, 0.04)
    bent: tuple[float, float] = (-0.15, 0.25)

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b 5"]:
        """Residuals of tilt, roll and log focal, and of k1_hat from both components of its mixture."""
        named = (vectors[:, [0, 1, 3]] - [0.0, 0.0, math.log(self.focal * self.longer)]) / np.array(self.sigma)
        k1_hat = vectors[:, 4:] * self.longer**2
        parts = [k1_hat / self.straight[1], (k1_hat - self.bent[0]) / self.bent[1]]
        return np.concatenate([named, *parts], axis=1)

    def loss(self, squares: Float64[ndarray, "*b 5"]) -> Float64[ndarray, "3 *b 5"]:
        """Student's loss; for the mixture, its cost for each component, with the component's probability as slope.

        A single residual, the root of the mixture's cost, would have zero slope at its peak and no information.
        """
        heights = self.straight[0] / self.straight[1], (1 - self.straight[0]) / self.bent[1]
        each = np.log(heights) - 0.5 * squares[..., 3:]
        both = np.logaddexp(each[..., :1], each[..., 1:])
        cost = np.broadcast_to(math.log(sum(heights)) - both, each.shape)
        mixture = np.stack([cost, np.exp(each - both), np.zeros_like(each)])
        parts = [student(squares[..., i : i + 1], nu) for i, nu in enumerate(self.nu)]
        return np.concatenate([*parts, mixture], axis=-1)


#: most independent measurements that all chains together are worth, and the number of longest ones used
CHAINS, MOST_CHAINS = 30.0, 40


class StraightChains(Term):
    """Residuals of chains of edge pixels, which are straight after undistortion.

    Args:
        chains: points in image heights from the centre.
        shorter: shorter side of the photo in image heights, of which the noise of edges is a fraction.
    """

    certainty = 0.1  # bent edges of one object bend alike: errors of k1_hat are three times those from the curvature

    def __init__(self, chains: Float64[ndarray, "n points 2"], shorter: float = 1.0):
        extent = np.linalg.norm(chains[:, -1] - chains[:, 0], axis=-1)
        self.chains = chains[np.argsort(-extent, kind="stable")[:MOST_CHAINS]]
        self.noise = NOISE * shorter
        self.share = min(1.0, CHAINS / max(len(self.chains), 1))

    def residuals(self, vectors: Vectors) -> Float64[ndarray, "b m"]:
        """The bows of all chains, then their S, as the two halves of the residuals."""
        k1_hat, focal = vectors[:, 4, None, None], np.exp(vectors[:, 3, None, None])
        points = undistort_points(self.chains[None], k1_hat, apparent_k2(k1_hat, focal))
        return np.concatenate(bends(self.chains, points), axis=1) / self.noise

    def loss(self, squares: Float64[ndarray, "*b m"]) -> Float64[ndarray, "3 *b m"]:
        """Cauchy's loss of each chain's bow and S together, which down-weights curved edges of the scene."""
        half = squares.shape[-1] // 2
        more = 1 + squares[..., :half] + squares[..., half:]
        rho = self.share * np.stack([np.log(more) / 2, 1 / more, -1 / np.square(more)])
        return np.concatenate([rho, rho], axis=-1)
