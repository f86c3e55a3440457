"""Intervals of what a user reads, from those of what the network predicts."""

import math

import torch

from sextant.applications.calibration.finding import Finding
from sextant.geometry import focal_from_vfov, vfov_from_focal


def focal_interval(finding: Finding, level: str) -> tuple[float, float]:
    """Pixels of the original; 0 and infinity where the interval of the field of view has no end."""
    vfov, half = float(vfov_from_focal(finding.camera.focal)), finding.half[level][2]
    wide, narrow = vfov + half, vfov - half
    low = float(focal_from_vfov(torch.tensor(wide, dtype=torch.float64))) if wide < math.pi else 0.0
    high = float(focal_from_vfov(torch.tensor(narrow, dtype=torch.float64))) if narrow > 0 else math.inf
    return low * finding.view.height, high * finding.view.height


def intervals(finding: Finding, level: str) -> dict[str, list[float]]:
    """Low and high ends in degrees and in pixels of the original; that of k1 is at the finding's focal length."""
    camera, height = finding.camera, finding.photo.height
    half = finding.half[level]
    k1_hat = float(camera.k1 / camera.focal.square())
    focal = focal_interval(finding, level)
    vfov = [math.degrees(2 * math.atan2(height / 2, f)) for f in reversed(focal)]
    angles = {
        f"{name}_deg": [math.degrees(value - h), math.degrees(value + h)]
        for name, value, h in (("tilt", float(camera.tilt), half[0]), ("roll", float(camera.roll), half[1]))
    }
    k1 = [float((k1_hat + sign * half[3]) * camera.focal.square()) for sign in (-1, 1)]
    return angles | {"focal_px": list(focal), "vfov_deg": vfov, "k1": k1}
