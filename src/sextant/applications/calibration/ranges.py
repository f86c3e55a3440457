"""Whether a camera is one that the network could have told: it answers within the range of cameras trained on alone."""

import math

import torch

from sextant.applications.calibration.finding import Finding
from sextant.applications.calibration.model import CalibrationModel
from sextant.geometry import CameraParameters, focal_from_vfov, vfov_from_focal

#: of a range: the cameras trained on end at :data:`ENDS`, for a range is a little wider than they spread
EDGE, ENDS = 0.01, 0.02 / 1.04
NAMES = ("vertical position of the horizon or tilt", "roll", "size", "distortion")
ANGLES = ("tilt", "roll", "field of view")


def range_doubts(finding: Finding, model: CalibrationModel) -> list[tuple[int, str]]:
    """What speaks against a camera at the end of the range trained on, or near it for how sure it is.

    What lies beyond an end is told as something before it, and the nearer the end, the surer: no camera trained on
    could be far off there. So an angle is doubted where its 95 % interval reaches beyond the end. Distortion is not:
    most lenses have none, which is the end of most ranges.

    Args:
        finding: the camera, with all that is known of it.
        model: that told it.
    """
    doubts = []
    position = model.position(_stacked(finding.camera))[0].tolist()
    if at := [name for name, p in zip(NAMES, position, strict=True) if not EDGE <= p <= 1 - EDGE]:
        told = ", ".join(at)
        doubts.append((1, f"at the end of what the network was trained on: {told}; the truth may lie beyond"))
    ends = model.position(_interval_ends(finding)).double()
    reached = [
        name
        for i, name in enumerate(ANGLES)
        if NAMES[i] not in at and not all(ENDS <= float(ends[k, i]) <= 1 - ENDS for k in (2 * i, 2 * i + 1))
    ]
    if reached:
        told = ", ".join(reached)
        doubts.append((1, f"the 95 % interval reaches beyond what the network was trained on: {told}"))
    return doubts


def _stacked(*cameras: CameraParameters) -> CameraParameters:
    return CameraParameters(*(torch.stack(values) for values in zip(*cameras, strict=True)))


def _interval_ends(finding: Finding) -> CameraParameters:
    """The camera with one of tilt, roll and field of view after the other at the low and high end of its interval."""
    camera = finding.camera
    ends = []
    for i, half in enumerate(finding.half["95"][:3]):
        for sign in (-1, 1):
            moved = [camera.tilt, camera.roll, vfov_from_focal(camera.focal)]
            moved[i] = moved[i] + sign * half
            tilt = moved[0].clamp(-math.pi / 2 + 1e-3, math.pi / 2 - 1e-3)
            ends.append(
                CameraParameters(tilt, moved[1], focal_from_vfov(moved[2].clamp(1e-3, math.pi - 1e-3)), camera.k1)
            )
    return _stacked(*ends)
