"""Photos of one camera and lens setting: their estimates made one."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sextant.applications.calibration.finding import Finding
from sextant.applications.calibration.fusing import adopt, estimate
from sextant.applications.calibration.options import CalibrationOptions
from sextant.applications.calibration.priors import disagreement, focal_prior
from sextant.errors import UserError
from sextant.evaluation.calibration.fusion import Fusion, Prior, fuse, with_prior

SAME_SHAPE = 0.02  # largest relative difference of aspect among photos of one camera


def fuse_as_one_camera(findings: Sequence[Finding], options: CalibrationOptions) -> dict[str, Any]:
    """Fuse focal length and distortion of all photos, and put them into each that agrees.

    Returns:
        What is told of the camera.

    Raises:
        UserError: the photos cannot be of one camera, or the network gives no intervals.
    """
    _check_one_camera(findings, options)
    estimates = [estimate(finding) for finding in findings]
    values, sigmas = (np.stack(column) for column in zip(*estimates, strict=True))
    if not np.isfinite(sigmas).any(0).all():
        raise UserError("camera=one: the network gives no intervals, without which nothing can be fused", "camera=each")
    fusion, doubts = _with_priors(fuse(values, sigmas), findings, options)
    if not fusion.consistent:
        doubts.append(
            f"the photos disagree more than their intervals allow (p = {fusion.p_value:.2g}): are they of one camera?"
        )
    for finding, kept in zip(findings, fusion.kept, strict=True):
        if kept:
            adopt(finding, fusion, f"fused over {int(fusion.kept.sum())} photos, normal")
            finding.doubts += [(1, text) for text in doubts]
        else:
            finding.doubts.append((1, "left out of the fusion: it disagrees with the other photos"))
    return _summary(findings, fusion, doubts)


def _with_priors(fusion: Fusion, findings: Sequence[Finding], options: CalibrationOptions) -> tuple[Fusion, list[str]]:
    """The fusion with the median of what is known of the focal length, and what speaks against that."""
    priors = [prior for finding in findings if (prior := focal_prior(finding, options))]
    doubts: list[str] = []
    if priors:
        means = np.array([prior.mean for prior in priors])
        if np.ptp(means) > 2 * priors[0].sigma:
            doubts.append("EXIF tells focal lengths that differ: a zoom lens is another camera at each setting")
        fusion = with_prior(fusion, 0, Prior(float(np.median(means)), priors[0].sigma))
        if text := disagreement(fusion.prior_z, options):
            doubts.append(text)
    return fusion, doubts


def _summary(findings: Sequence[Finding], fusion: Fusion, doubts: list[str]) -> dict[str, Any]:
    return {
        "photos": len(findings),
        "kept": [str(f.path) for f, kept in zip(findings, fusion.kept, strict=True) if kept],
        "left_out": [str(f.path) for f, kept in zip(findings, fusion.kept, strict=True) if not kept],
        "focal_of_longer_side": math.exp(fusion.values[0]),
        "focal_log_sigma": float(fusion.sigmas[0]),
        "k1_hat_of_longer_side": float(fusion.values[1]),
        "k1_hat_sigma": float(fusion.sigmas[1]),
        "chi_square": fusion.chi_square,
        "degrees_of_freedom": fusion.degrees,
        "p_value": fusion.p_value,
        "consistent": fusion.consistent,
        "prior_z": fusion.prior_z,
        "doubts": doubts,
    }


def _check_one_camera(findings: Sequence[Finding], options: CalibrationOptions) -> None:
    shapes = {f.path: f.side / min(f.photo.width, f.photo.height) for f in findings}
    first, last = min(shapes, key=lambda p: shapes[p]), max(shapes, key=lambda p: shapes[p])
    if shapes[last] / shapes[first] - 1 > SAME_SHAPE:
        raise UserError(
            f"camera=one: {first} and {last} have sides of 1:{shapes[first]:.3f} and 1:{shapes[last]:.3f}, so that one "
            "of them was cropped or is of another camera",
            "Take it out, or calibrate each photo by itself: camera=each",
        )
    sides = {finding.side for finding in findings}
    if isinstance(options.focal_prior, float) and len(sides) > 1:
        raise UserError(
            f"camera=one focal_prior={options.focal_prior:g}: the photos have longer sides of {min(sides)} to "
            f"{max(sides)} pixels, so that their focal lengths in pixels differ",
            "Give photos of one size, or focal_prior=exif",
        )
