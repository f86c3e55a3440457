"""What may be chosen of the calibration of photos."""

from dataclasses import dataclass
from typing import Literal

Undistort = Literal["crop", "all", "none"]
Cameras = Literal["each", "one"]


@dataclass(frozen=True)
class CalibrationOptions:
    """What the user chose.

    Attributes:
        undistort: straightened photos keep no borders (``crop``), every pixel (``all``), or are not made.
        camera: photos are of one camera and lens setting each, or all of one.
        focal_prior: ``exif``, or a focal length in pixels of the photo that is known beforehand.
    """

    undistort: Undistort = "crop"
    camera: Cameras = "each"
    focal_prior: Literal["none", "exif"] | float = "none"
