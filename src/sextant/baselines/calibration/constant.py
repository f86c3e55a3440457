"""Image-independent calibration: the baselines that every method must beat."""

from typing import Self

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray

from sextant.baselines.calibration.estimate import (
    CalibrationBaseline,
    CalibrationEstimate,
    check_image,
    prior_of_cameras,
)
from sextant.geometry import CameraParameters


class ConstantCamera(CalibrationBaseline):
    """The median of the training labels, parameter by parameter: tilt, roll, vertical field of view and k1.

    (The median field of view and the median focal length give the same camera; the median is of k1, not of k1_hat.)

    Attributes:
        camera_: the fitted camera.

    Example:
        >>> labels = torch.tensor([[0.0, 0.1, 0.5], [0.0, 0.0, 0.0], [0.8, 1.0, 3.0], [0.0, -0.1, -0.2]])
        >>> constant = ConstantCamera().fit(CameraParameters(*labels))  # tilt, roll, focal and k1 of three cameras
        >>> found = constant.calibrate(np.zeros((48, 64, 3), np.uint8)).camera
        >>> [round(float(value), 3) for value in found]
        [0.1, 0.0, 1.0, -0.1]
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
        prior: belief about the camera where ``fit`` is not called.

    Example:
        >>> labels = torch.tensor([[0.0, 0.1, 0.5], [0.0, 0.0, 0.0], [0.8, 1.0, 3.0], [0.0, -0.1, -0.2]])
        >>> prior = PriorCamera().fit(CameraParameters(*labels))  # tilt, roll, focal and k1 of three cameras
        >>> found = prior.calibrate(np.zeros((48, 64, 3), np.uint8)).camera
        >>> [round(float(value), 3) for value in found]
        [0.0, 0.0, 1.0, 0.0]
    """

    def calibrate(self, image: UInt8[ndarray, "h w 3"]) -> CalibrationEstimate:
        """The same camera for every image."""
        check_image(image)
        return CalibrationEstimate.of_prior(self.prior_, long_segments=0)
