"""Calibration without looking: the answers that every method must beat."""

from typing import Self

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.baselines.calibration.estimate import CalibrationEstimate, CameraPrior
from sextant.baselines.calibration.method import CalibrationBaseline, check_image
from sextant.geometry import CameraParameters

#: The median absolute deviation of a Gaussian is 1 / 1.4826 of its standard deviation.
MAD_TO_SIGMA = 1.4826


def prior_of_cameras(cameras: CameraParameters, *, level: bool = False) -> CameraPrior:
    """The belief that training labels justify: their medians and spreads (1.48 median absolute deviations).

    Args:
        cameras: a batch.
        level: means of tilt, roll and k1_hat are 0 rather than medians; the spreads are then about 0.

    Raises:
        ValueError: there is no camera.
    """
    values = _beliefs(cameras)
    centre = np.median(values, axis=0)
    if level:
        centre[[0, 1, 3]] = 0
    spread = MAD_TO_SIGMA * np.median(np.abs(values - centre), axis=0)
    # constant labels leave no spread, heavy tails (roll) too little: the second moment helps with both
    spread = np.maximum(spread, 0.5 * np.sqrt(np.mean((values - centre) ** 2, axis=0)))
    return CameraPrior.of_vector(centre, np.maximum(spread, 1e-3))


class ConstantCamera(CalibrationBaseline):
    """The median of the training labels, parameter by parameter: tilt, roll, vertical field of view and k1.

    (The median field of view and the median focal length are the same camera; for k1 itself, not k1_hat.)

    Attributes:
        camera_: the fitted camera.
    """

    def fit(self, cameras: CameraParameters) -> Self:
        """Take the medians of a batch of cameras."""
        self.prior_ = prior_of_cameras(cameras)
        medians = [torch.as_tensor(np.median(value.double().cpu().numpy())) for value in cameras]
        self.camera_ = CameraParameters(*medians)
        return self

    def calibrate(self, image: UInt8[ndarray, "h w 3"]) -> CalibrationEstimate:
        """The same camera for every image."""
        check_image(image)
        blind = CalibrationEstimate.of_prior(self.prior_, long_segments=0)
        return CalibrationEstimate(self.camera_, blind.determined, blind.covariance, 0)


class PriorCamera(CalibrationBaseline):
    """A level camera without distortion, and the median field of view of the training labels.

    Args:
        prior: what is believed where ``fit`` is not called.
    """

    def __init__(self, prior: CameraPrior | None = None):
        self.prior_ = prior or CameraPrior()

    def fit(self, cameras: CameraParameters) -> Self:
        """Take the field of view, and how far cameras stray from being level, from a batch of cameras."""
        self.prior_ = prior_of_cameras(cameras, level=True)
        return self

    def calibrate(self, image: UInt8[ndarray, "h w 3"]) -> CalibrationEstimate:
        """The same camera for every image."""
        check_image(image)
        return CalibrationEstimate.of_prior(self.prior_, long_segments=0)


def _beliefs(cameras: CameraParameters) -> Float64[ndarray, "n 4"]:
    tilt, roll, focal, k1 = (np.atleast_1d(value.double().cpu().numpy()) for value in cameras)
    if tilt.size == 0:
        raise ValueError("need at least one camera to learn a prior from")
    return np.stack([tilt, roll, np.log(focal), k1 / focal**2], axis=-1)
