"""Prior knowledge: a focal length from EXIF or from the user, and gravity from the phone's accelerometer."""

import math
from dataclasses import replace
from numbers import Real
from typing import Literal

import numpy as np

from sextant.baselines.calibration import FOCAL_HEIGHTS, FocalBelief, GravityBelief
from sextant.chapters.calibration.finding import Finding
from sextant.chapters.calibration.fusing import adopt, estimate
from sextant.chapters.calibration.jointly import jointly
from sextant.chapters.calibration.metrics.fusion import Prior, fuse, with_prior
from sextant.errors import ArgumentError, shown

#: a focal length in pixels of the photo, the one in EXIF, or none
FocalPrior = float | Literal["exif"] | None
#: standard deviation of the log of a focal length. EXIF: rounding to whole millimetres (2 % at 26 mm), makers that
#: compare widths and not diagonals (4 %), lens corrections that crop. Given by hand: a typical user's accuracy.
PRIOR_SIGMA = {"exif": 0.05, "given": 0.02}
NONE_IN_EXIF = "EXIF contains no focal length: none was used"
PRIOR_DISAGREES = 3.0  # standard errors
#: gravity from the accelerometer, in the photo's metadata, or none
GravityPrior = Literal["exif"] | None
#: standard deviation of an accelerometer per direction (radians): hand motion, and a slightly misaligned sensor
GRAVITY_SIGMA = math.radians(1.5)


def check_priors(focal_prior: FocalPrior, gravity_prior: GravityPrior) -> None:
    """Raise an ``ArgumentError`` unless they are a focal length, ``exif`` or None, and ``exif`` or None."""
    if not _by_name(gravity_prior):
        raise ArgumentError(f"gravity_prior={shown(gravity_prior)} must be None or exif", "gravity_prior=exif")
    number = float(focal_prior) if isinstance(focal_prior, Real) and not isinstance(focal_prior, bool) else math.nan
    if not _by_name(focal_prior) and not 0 < number < math.inf:
        raise ArgumentError(
            f"focal_prior={shown(focal_prior)} must be None, exif or a focal length in pixels above 0",
            "focal_prior=exif",
        )


def _by_name(prior: object) -> bool:
    return prior is None or (isinstance(prior, str) and prior == "exif")


def prior_of(finding: Finding, focal_prior: FocalPrior) -> Prior | None:
    """The prior of the log of the focal length in longer sides; None if nothing is known or is to be used.

    Raises:
        ArgumentError: the given focal length is outside the range of the search.
    """
    if focal_prior == "exif":
        known = finding.photo.exif_focal_px
        return Prior(math.log(known / finding.side), PRIOR_SIGMA["exif"]) if known else None
    if focal_prior is None:
        return None
    low, high = (finding.photo.height * end for end in FOCAL_HEIGHTS)
    if not low <= focal_prior <= high:
        raise ArgumentError(
            f"focal_prior={focal_prior:g}: focal lengths of a photo {finding.photo.height} pixels high must be from "
            f"{low:.0f} to {high:.0f} pixels (of the file, not millimetres)",
            "focal_prior=exif",
        )
    return Prior(math.log(focal_prior / finding.side), PRIOR_SIGMA["given"])


def disagreement(z: float, focal_prior: FocalPrior) -> list[str]:
    """A doubt about a prior that is ``z`` standard errors from the picture's estimate; none if it is close enough."""
    if not abs(z) > PRIOR_DISAGREES:
        return []
    return [f"the focal length by focal_prior={focal_prior} and the picture disagree by {abs(z):.1f} standard errors"]


def with_focal_prior(finding: Finding, focal_prior: FocalPrior) -> Finding:
    """The finding fused with the prior of its focal length; a prior that is not used may still raise doubts."""
    prior = prior_of(finding, focal_prior)
    known = finding.photo.exif_focal_px
    if prior is None:
        if focal_prior == "exif":
            return finding.doubted(0, NONE_IN_EXIF)
        if known:
            low, high = finding.focal_interval("95")
            if not low <= known <= high:
                return finding.doubted(1, f"EXIF gives a focal length of {known:.0f} px, outside the 95 % interval")
        return finding
    if finding.network is not None:
        return _jointly_with(finding, prior, focal_prior)
    values, sigmas = estimate(finding)
    if not np.isfinite(sigmas).all():
        return finding.doubted(2, "the focal length of the prior was not used: the network gives no interval")
    fusion = with_prior(fuse(values[None], sigmas[None]), 0, prior)
    fused = adopt(finding, fusion, f"focal_prior={focal_prior}, normal")
    return fused.doubted(1, *disagreement(fusion.prior_z, focal_prior))


def with_gravity(finding: Finding, gravity_prior: GravityPrior) -> Finding:
    """The finding with the accelerometer's gravity as evidence; gravity that is not used may still raise doubts."""
    held, doubts = _held(finding, gravity_prior)
    return held.doubted(0 if held.photo.gravity is None else 1, *doubts)


def with_priors(finding: Finding, focal_prior: FocalPrior, gravity_prior: GravityPrior) -> Finding:
    """The finding with both priors as evidence, and the doubts that either raises."""
    held, doubts = _held(finding, gravity_prior)
    return with_focal_prior(held, focal_prior).doubted(0 if held.photo.gravity is None else 1, *doubts)


def _held(finding: Finding, gravity_prior: GravityPrior) -> tuple[Finding, list[str]]:
    """The finding with gravity as requested, and doubts about it."""
    known = finding.photo.gravity
    if known is None:
        return finding, ["the metadata contain no gravity: none was used"] * (gravity_prior is not None)
    belief = GravityBelief(known, GRAVITY_SIGMA)
    off = np.array(belief.pose) - [float(finding.camera.tilt), float(finding.camera.roll)]
    steep = max(math.cos(belief.pose[0]), GRAVITY_SIGMA)  # near the vertical, roll is undetermined
    doubts: list[str] = []
    if (np.abs(off) > np.hypot(finding.half["95"][:2], [2 * GRAVITY_SIGMA, 2 * GRAVITY_SIGMA / steep])).any():
        tilt, roll = (math.degrees(angle) for angle in belief.pose)
        said = f"the accelerometer gives a tilt of {tilt:.0f}° and a roll of {roll:.0f}°"
        doubts = [f"{said}, which the picture contradicts"]
    if gravity_prior is None:
        return finding, doubts
    if finding.network is None:
        return finding, [*doubts, "gravity was not used: method=network does not support it"]
    return jointly(replace(finding, gravity=belief)), doubts


def _jointly_with(finding: Finding, prior: Prior, focal_prior: FocalPrior) -> Finding:
    """The finding with the focal length as evidence; EXIF that contradicts the picture is not used."""
    values, sigmas = estimate(finding)
    z = float((prior.mean - values[0]) / np.hypot(sigmas[0], prior.sigma))
    doubts = disagreement(z, focal_prior)
    if doubts and focal_prior == "exif":
        return finding.doubted(1, f"{doubts[0]}: it was not used")
    focal = math.exp(prior.mean) * finding.side / finding.photo.height
    return jointly(finding, [FocalBelief(focal, prior.sigma)]).doubted(1, *doubts)
