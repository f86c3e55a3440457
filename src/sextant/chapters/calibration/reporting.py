"""From a finding to the camera that is reported: in degrees, and in pixels of the upright original."""

import math

from sextant.chapters.calibration.confidence import confidence
from sextant.chapters.calibration.finding import Finding
from sextant.chapters.calibration.network import CameraNetwork
from sextant.chapters.calibration.photo_camera import Intervals, PhotoCamera


def photo_camera(finding: Finding, network: CameraNetwork) -> PhotoCamera:
    """The camera of a photo with its intervals, and how far it can be trusted."""
    camera, photo, view = finding.camera, finding.photo, finding.view
    verdict, reasons, widths = confidence(finding, network)
    return PhotoCamera(
        name=finding.name,
        width=photo.width,
        height=photo.height,
        exif_orientation=photo.orientation,
        exif_focal_px=photo.exif_focal_px,
        tilt_deg=math.degrees(camera.tilt),
        roll_deg=math.degrees(camera.roll),
        focal_px=finding.focal_px,
        k1=float(camera.k1),
        k2=float(finding.k2),
        interval_68=_intervals(finding, "68"),
        interval_95=_intervals(finding, "95"),
        intervals_by=finding.basis,
        verdict=verdict,
        reasons=reasons,
        width_over_training_spread=widths,
        seen=(view.left, view.top, view.width, view.height),
    )


def _intervals(finding: Finding, level: str) -> Intervals:
    camera, half = finding.camera, finding.half[level]
    k1_hat = float(camera.k1 / camera.focal.square())
    low, high = finding.focal_interval(level)
    narrow, wide = (math.degrees(2 * math.atan2(finding.photo.height / 2, focal)) for focal in (high, low))
    return Intervals(
        tilt_deg=_around(float(camera.tilt), half[0]),
        roll_deg=_around(float(camera.roll), half[1]),
        focal_px=(low, high),
        vfov_deg=(narrow, wide),
        k1=(float((k1_hat - half[3]) * camera.focal.square()), float((k1_hat + half[3]) * camera.focal.square())),
    )


def _around(value: float, half: float) -> tuple[float, float]:
    return math.degrees(value - half), math.degrees(value + half)
