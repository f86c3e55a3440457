"""Priors on a camera, and the estimates of geometric methods given an image."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.errors import UserError
from sextant.geometry import CameraParameters

#: The median absolute deviation of a Gaussian is 1 / 1.4826 of its standard deviation.
MAD_TO_SIGMA = 1.4826
#: The four numbers in which beliefs are Gaussian; ``k1_hat = k1 / focal^2`` is the distortion visible in an image.
BELIEF_NAMES = ("tilt", "roll", "log_focal", "k1_hat")


class Determined(NamedTuple):
    """Which of the parameters the image determines; the others stay near the prior's value."""

    tilt: bool
    roll: bool
    focal: bool
    k1: bool


@dataclass(frozen=True)
class CameraPrior:
    """Independent Gaussian beliefs about a camera.

    Args:
        tilt, roll: means in radians.
        focal: in image heights; the belief is Gaussian in its logarithm.
        k1_hat: apparent distortion ``k1 / focal^2``.
        sigma: standard deviations of tilt, roll, log focal and k1_hat.

    Raises:
        UserError: a value is not finite, or the focal length or a standard deviation is not above 0.

    Example:
        >>> prior = CameraPrior(tilt=0.1, focal=2.0, sigma=(0.3, 0.15, 0.4, 0.3))
        >>> prior.vector.round(4).tolist()  # the focal length by its logarithm
        [0.1, 0.0, 0.6931, 0.0]
    """

    tilt: float = 0.0
    roll: float = 0.0
    focal: float = 0.87
    k1_hat: float = 0.0
    sigma: tuple[float, float, float, float] = (0.30, 0.15, 0.40, 0.30)

    def __post_init__(self) -> None:
        values = (self.tilt, self.roll, self.focal, self.k1_hat, *self.sigma)
        if not all(np.isfinite(values)) or min(self.focal, *self.sigma) <= 0:
            raise UserError(
                f"a belief about a camera needs finite values, focal > 0 and sigma > 0; got {self}",
                "For example CameraPrior(focal=0.87, sigma=(0.3, 0.15, 0.4, 0.3)).",
            )

    @classmethod
    def of_vector(
        cls, vector: Float64[ndarray, "4"], sigma: tuple[float, float, float, float] | Float64[ndarray, "4"]
    ) -> "CameraPrior":
        """The belief with mean ``vector``, in the order of :data:`BELIEF_NAMES`."""
        tilt, roll, log_focal, k1_hat = (float(value) for value in vector)
        first, second, third, fourth = (float(value) for value in sigma)
        return cls(tilt, roll, float(np.exp(log_focal)), k1_hat, (first, second, third, fourth))

    @property
    def vector(self) -> Float64[ndarray, "4"]:
        """The mean, in the order of :data:`BELIEF_NAMES`."""
        return np.array([self.tilt, self.roll, np.log(self.focal), self.k1_hat])


def prior_of_cameras(cameras: CameraParameters, *, level: bool = False) -> CameraPrior:
    """The prior given training labels: medians and spreads (1.48 median absolute deviations, or more for long tails).

    Args:
        cameras: a batch.
        level: means of tilt, roll and k1_hat are 0 rather than medians; the spreads are then about 0.

    Raises:
        ValueError: there is no camera.

    Example:
        >>> import torch
        >>> tilt, zero = torch.tensor([0.1, 0.2, 0.3]), torch.zeros(3)
        >>> prior = prior_of_cameras(CameraParameters(tilt, roll=zero, focal=zero + 1, k1=zero))
        >>> round(prior.tilt, 4), round(prior.sigma[0], 4), prior.sigma[1]  # 1.4826 · 0.1; what never varies has 0.001
        (0.2, 0.1483, 0.001)
    """
    values = _beliefs(cameras)
    centre = np.median(values, axis=0)
    if level:
        centre[[0, 1, 3]] = 0
    spread = MAD_TO_SIGMA * np.median(np.abs(values - centre), axis=0)
    # heavy tails (roll) and mostly constant labels have too small a median deviation: half the RMS is the least
    spread = np.maximum(spread, 0.5 * np.sqrt(np.mean((values - centre) ** 2, axis=0)))
    return CameraPrior.of_vector(centre, np.maximum(spread, 1e-3))


def _beliefs(cameras: CameraParameters) -> Float64[ndarray, "n 4"]:
    tilt, roll, focal, k1 = (np.atleast_1d(value.double().cpu().numpy()) for value in cameras)
    if tilt.size == 0:
        raise ValueError("need at least one camera to learn a prior from")
    return np.stack([tilt, roll, np.log(focal), k1 / focal**2], axis=-1)


@dataclass(frozen=True)
class CalibrationEstimate:
    """The calibration of one image.

    Attributes:
        camera: tensors without dimensions; always finite, since undetermined parameters come from the prior.
        determined: which parameters the image determines: those with a standard deviation below half the prior's.
        covariance: covariance of tilt, roll, log focal and k1_hat given image and prior; the prior's without lines.
        long_segments: number of line segments longer than 0.1 image heights; chains of edge pixels for plumb lines.

    Example:
        >>> prior = CameraPrior(focal=2.0, sigma=(0.3, 0.15, 0.1, 0.3))
        >>> estimate = CalibrationEstimate.of_prior(prior, long_segments=0)
        >>> estimate.determined.focal, round(float(estimate.sigma.focal), 6)  # 0.1 of the logarithm is 10 % of 2
        (False, 0.2)
    """

    camera: CameraParameters
    determined: Determined
    covariance: Float64[ndarray, "4 4"]
    long_segments: int

    @classmethod
    def of_vector(
        cls, vector: Float64[ndarray, "4"], covariance: Float64[ndarray, "4 4"], prior: CameraPrior, long_segments: int
    ) -> "CalibrationEstimate":
        """The estimate with mean ``vector``, in the order of :data:`BELIEF_NAMES`."""
        sharper = np.sqrt(np.diag(covariance)) < 0.5 * np.array(prior.sigma)
        return cls(camera_of_vector(vector), Determined(*(bool(one) for one in sharper)), covariance, long_segments)

    @classmethod
    def of_prior(cls, prior: CameraPrior, long_segments: int) -> "CalibrationEstimate":
        """The estimate for an image without evidence."""
        return cls.of_vector(prior.vector, np.diag(np.square(prior.sigma)), prior, long_segments)

    @property
    def sigma(self) -> CameraParameters:
        """Standard deviations of tilt, roll, focal and k1, to first order."""
        focal, k1 = float(self.camera.focal), float(self.camera.k1)
        by_belief = np.diag([1.0, 1.0, focal, focal * focal])  # of (tilt, roll, focal, k1) by BELIEF_NAMES
        by_belief[3, 2] = 2 * k1
        variances = np.diag(by_belief @ self.covariance @ by_belief.T)
        return CameraParameters(*torch.as_tensor(np.sqrt(np.maximum(variances, 0))).unbind())


def camera_of_vector(vector: Float64[ndarray, "4"]) -> CameraParameters:
    """The camera of four numbers in the order of :data:`BELIEF_NAMES`.

    Example:
        >>> camera = camera_of_vector(np.array([0.1, 0.0, np.log(2.0), -0.05]))
        >>> [round(float(value), 6) for value in camera]  # k1 is k1_hat · focal²
        [0.1, 0.0, 2.0, -0.2]
    """
    tilt, roll, log_focal, k1_hat = vector
    focal = np.exp(log_focal)
    return CameraParameters(*torch.tensor([tilt, roll, focal, k1_hat * focal**2], dtype=torch.float64).unbind())


def stack_cameras(estimates: list[CalibrationEstimate]) -> CameraParameters:
    """The cameras of several images as one batch.

    Raises:
        ValueError: there is none.

    Example:
        >>> priors = CameraPrior(focal=0.8), CameraPrior(focal=1.2)
        >>> stack_cameras([CalibrationEstimate.of_prior(prior, long_segments=0) for prior in priors]).focal
        tensor([0.8000, 1.2000], dtype=torch.float64)
    """
    if not estimates:
        raise ValueError("need at least one estimate to stack")
    return CameraParameters(*(torch.stack(values) for values in zip(*(e.camera for e in estimates), strict=True)))


class CalibrationBaseline(ABC):
    """A method that calibrates single images and learns only a prior, from training labels.

    Args:
        prior: belief about the camera; ``fit`` replaces it.
        seed: seed of all random draws; the same image and seed give the same camera.
    """

    def __init__(self, prior: CameraPrior | None = None, seed: int = 0):
        self.prior_, self.seed = prior or CameraPrior(), seed

    def fit(self, cameras: CameraParameters) -> Self:
        """Learn the spread of a batch of training cameras around a level camera without distortion."""
        self.prior_ = prior_of_cameras(cameras, level=True)
        return self

    @abstractmethod
    def calibrate(self, image: UInt8[ndarray, "h w 3"]) -> CalibrationEstimate:
        """The camera that took ``image``."""

    def calibrate_many(self, images: UInt8[ndarray, "n h w 3"]) -> CameraParameters:
        """The cameras of several images, one by one.

        Raises:
            ValueError: there is no image.
        """
        return stack_cameras([self.calibrate(image) for image in images])


def check_image(image: UInt8[ndarray, "h w 3"]) -> None:
    """Refuse anything but an 8-bit RGB image.

    Raises:
        ValueError: the image is empty, or of another type or shape.
    """
    if image.dtype != "uint8" or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ValueError(f"need a uint8 RGB image (h, w, 3), got {image.dtype} {image.shape}")
