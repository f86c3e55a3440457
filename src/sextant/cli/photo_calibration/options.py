"""What a user may choose of the calibration of photos; imports nothing heavy."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from sextant.cli.arguments import one_of
from sextant.errors import UserError

KEYS = {
    "undistort": "crop (default: no borders), all (every pixel is kept, with borders) or none (no straightened photos)",
    "camera": "each (default), or one: all photos are of one camera and lens setting, and are fused",
    "focal_prior": "none (default), exif, or a focal length in pixels of the photo",
}
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
    focal_prior: float | Literal["exif"] | None = None


def options_from(given: Mapping[str, str]) -> CalibrationOptions:
    """Read the keys of :data:`KEYS`.

    Raises:
        UserError: a value is not one of those allowed.
    """
    undistort, camera = one_of(given, "undistort", get_args(Undistort)), one_of(given, "camera", get_args(Cameras))
    return CalibrationOptions(undistort, camera, _prior(given.get("focal_prior", "none")))


def _prior(text: str) -> float | Literal["exif"] | None:
    if text == "none":
        return None
    if text == "exif":
        return "exif"
    try:
        prior = float(text)
    except ValueError:
        prior = math.nan
    if not (math.isfinite(prior) and prior > 0):
        raise UserError(
            f"focal_prior={text} must be none, exif or a focal length in pixels above 0", "focal_prior=exif"
        )
    return prior
