"""The base of all calibration baselines."""

from abc import ABC, abstractmethod
from typing import Self

from jaxtyping import UInt8
from numpy import ndarray

from sextant.baselines.calibration.estimate import CalibrationEstimate, CameraPrior, stack_cameras
from sextant.baselines.calibration.training_prior import prior_of_cameras
from sextant.geometry import CameraParameters


class CalibrationBaseline(ABC):
    """A method that calibrates single images without learning more than a prior from the training labels.

    Args:
        prior: belief about the camera; ``fit`` replaces it.
        seed: seed of all random draws; the same image and seed give the same camera.
    """

    def __init__(self, prior: CameraPrior | None = None, seed: int = 0):
        self.prior_, self.seed = prior or CameraPrior(), seed

    def fit(self, cameras: CameraParameters) -> Self:
        """Learn how a batch of training cameras is spread around a level camera without distortion."""
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
    """Refuse what is not an RGB image of 8 bits.

    Raises:
        ValueError: the image is empty, or of another type or shape.
    """
    if image.dtype != "uint8" or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ValueError(f"need a uint8 RGB image (h, w, 3), got {image.dtype} {image.shape}")
