"""All that is told of a photo's camera, as plain numbers: the content of its JSON file."""

import math
from typing import Any

import torch

from sextant.applications.calibration.confidence import confidence
from sextant.applications.calibration.finding import LEVELS, Finding
from sextant.applications.calibration.intervals import intervals
from sextant.applications.calibration.model import CalibrationModel
from sextant.geometry import undistort_radius


def camera_row(finding: Finding, model: CalibrationModel) -> dict[str, Any]:
    """The camera of the whole upright original, with intervals, trust, and the conventions of other programs."""
    camera, photo, view = finding.camera, finding.photo, finding.view
    focal, width, height = finding.focal_px, photo.width, photo.height
    k1, k2 = float(camera.k1), float(finding.k2)
    ends = torch.tensor([width, height], dtype=torch.float64) / 2 / focal
    true = torch.rad2deg(2 * torch.atan(undistort_radius(ends, camera.k1, finding.k2))).tolist()
    return {
        "width": width,
        "height": height,
        "exif_orientation": photo.orientation,
        "tilt_deg": math.degrees(camera.tilt),
        "roll_deg": math.degrees(camera.roll),
        "focal_px": focal,
        "vfov_deg": math.degrees(2 * math.atan(height / 2 / focal)),
        "true_vfov_deg": true[1],
        "true_hfov_deg": true[0],
        "k1": k1,
        "k2": k2,
        "k1_hat": k1 * (height / focal) ** 2,
        "intervals": {level: intervals(finding, level) for level in LEVELS},
        "intervals_by": finding.basis,
        "exif_focal_px": photo.exif_focal_px,
        "confidence": confidence(finding, model),
        "opencv": {
            "matrix": [[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]],
            "distortion": [k1, k2, 0, 0, 0],
        },
        "colmap": {"model": "RADIAL", "parameters": [focal, width / 2, height / 2, k1, k2]},
        "seen": {"left": view.left, "top": view.top, "width": view.width, "height": view.height, "share": view.share},
        "units": "pixels of the upright original (after EXIF orientation); tilt > 0 looks up; vfov_deg is nominal, "
        "2 atan(height / 2 f), true_* are with distortion; k1_hat is k1 / f² in heights of the photo; "
        "the interval of k1 is at this focal length",
    }
