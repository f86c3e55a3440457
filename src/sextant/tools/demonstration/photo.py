"""One photo: its horizon, the direction of gravity, how its lens bends lines, a level copy, and camera parameters."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from sextant.chapters.calibration.calibrator import PhotoCalibrator
from sextant.chapters.calibration.photo_camera import PhotoCamera
from sextant.data.photos import read_photo
from sextant.data.photos.straightening import level_photo
from sextant.tools.demonstration.pictures import data_address, shrunk

#: width in millimetres of full frame, the format for which photographers state focal lengths
FULL_FRAME = 36
#: every n-th point of a curve is drawn
EVERY = 10


def photo_answer(calibrator: PhotoCalibrator, path: Path) -> dict[str, Any]:
    """The results for a photo.

    Lines are in heights of the picture from its centre, u to the right and v downwards.

    Args:
        calibrator: calibrates the photo.
        path: file of the photo.

    Raises:
        UserError: the photo cannot be read or calibrated.
    """
    camera = calibrator.calibrate(path)
    image = shrunk(read_photo(path).image)
    return {
        "picture": data_address(image),
        "width": camera.width,
        "height": camera.height,
        **_lines(camera, image),
        **_levelled(camera, image),
        "quantities": _quantities(camera),
        "verdict": camera.verdict,
        "reasons": list(camera.reasons),
        "intervals_by": camera.intervals_by,
    }


def _lines(camera: PhotoCamera, image: ndarray) -> dict[str, Any]:
    from sextant.chapters.calibration.figures.overlay import distortion_grid, gravity_arrows

    drawn = camera.drawn(image)
    points, down = gravity_arrows(drawn)
    return {
        "horizon": _pieces(drawn.horizon()),
        "horizon_is": drawn.horizon_is(),
        "gravity": np.hstack([points, down]).round(4).tolist(),
        "grid": [piece for line in distortion_grid(drawn) for piece in _pieces(line)],
    }


def _pieces(curve: Float[ndarray, "n 2"]) -> list[list[list[float]]]:
    """The contiguous pieces of a curve without nan."""
    curve = curve[::EVERY]
    there = np.isfinite(curve).all(axis=1)
    runs = np.split(curve, np.flatnonzero(there[1:] != there[:-1]) + 1)
    return [run.round(4).tolist() for run in runs if len(run) > 1 and np.isfinite(run).all()]


def _levelled(camera: PhotoCamera, image: ndarray) -> dict[str, Any]:
    focal = camera.focal_px * image.shape[0] / camera.height
    tilt, roll = math.radians(camera.tilt_deg), math.radians(camera.roll_deg)
    level, without_tilt = level_photo(image, tilt, roll, focal, camera.k1, camera.k2)
    return {"levelled": data_address(level), "without_tilt": without_tilt}


def _quantities(camera: PhotoCamera) -> list[dict[str, Any]]:
    to_mm = FULL_FRAME / max(camera.width, camera.height)
    rows = [
        ("tilt", "tilt_deg", "°", 1.0, "positive looks up"),
        ("roll", "roll_deg", "°", 1.0, "positive: the right side of the camera is lower"),
        ("vertical field of view", "vfov_deg", "°", 1.0, "from the lower to the upper edge"),
        ("focal length", "focal_px", "px", 1.0, "in pixels of the whole photo"),
        ("35 mm equivalent", "focal_px", "mm", to_mm, "focal length on full frame, 36 mm wide"),
        ("distortion k1", "k1", "", 1.0, "negative is barrel distortion"),
    ]
    return [
        {
            "name": name,
            "value": scale * getattr(camera, key),
            "unit": unit,
            "about": about,
            "68": _ends(getattr(camera.interval_68, key), scale),
            "95": _ends(getattr(camera.interval_95, key), scale),
        }
        for name, key, unit, scale, about in rows
    ]


def _ends(ends: tuple[float, float], scale: float) -> list[float | None]:
    """Both ends, None for infinity, which JSON does not have."""
    return [scale * end if math.isfinite(end) else None for end in ends]
