"""What a user may choose of the calibration of photos; imports nothing but the standard library."""

import math
from collections.abc import Mapping
from typing import Any, get_args

from sextant.applications.calibration.options import CalibrationOptions, Cameras, Undistort
from sextant.errors import UserError

KEYS = {
    "undistort": "crop (default: no borders), all (every pixel is kept, with borders) or none (no straightened photos)",
    "camera": "each (default), or one: all photos are of one camera and lens setting, and are fused",
    "focal_prior": "none (default), exif, or a focal length in pixels of the photo",
}


def options_from(given: Mapping[str, str]) -> CalibrationOptions:
    """Read the keys of :data:`KEYS`.

    Raises:
        UserError: a value is not one of those allowed.
    """
    for key, allowed in (("undistort", get_args(Undistort)), ("camera", get_args(Cameras))):
        if given.get(key, allowed[0]) not in allowed:
            raise UserError(
                f"{key}={given[key]} must be one of {', '.join(allowed)}", f"For example {key}={allowed[0]}"
            )
    text = given.get("focal_prior", "none")
    prior: Any = text
    if text not in ("none", "exif"):
        try:
            prior = float(text)
        except ValueError:
            prior = math.nan
        if not (math.isfinite(prior) and prior > 0):
            raise UserError(
                f"focal_prior={text} must be none, exif or a focal length in pixels above 0", "focal_prior=exif"
            )
    undistort, camera = given.get("undistort", "crop"), given.get("camera", "each")
    return CalibrationOptions(undistort, camera, prior)  # type: ignore[arg-type]  # checked above
