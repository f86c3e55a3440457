"""A focal length that is known beforehand: by EXIF, or because the user knows it."""

import math

import numpy as np

from sextant.applications.calibration.finding import Finding
from sextant.applications.calibration.fusing import adopt, estimate
from sextant.applications.calibration.intervals import focal_interval
from sextant.applications.calibration.options import CalibrationOptions
from sextant.evaluation.calibration.fusion import Prior, fuse, with_prior

#: standard deviation of the log of a focal length. EXIF: whole millimetres (2 % at 26 mm), makers that compare widths
#: and not diagonals (4 %), lens corrections that crop. Given by hand: as a person knows it.
PRIOR_SIGMA = {"exif": 0.05, "given": 0.02}
PRIOR_DISAGREES = 3.0  # standard errors


def focal_prior(finding: Finding, options: CalibrationOptions) -> Prior | None:
    """What is known of the log of the focal length in longer sides; None where nothing is, or shall not be used."""
    if options.focal_prior == "exif":
        known = finding.photo.exif_focal_px
        return Prior(math.log(known / finding.side), PRIOR_SIGMA["exif"]) if known else None
    if options.focal_prior == "none":
        return None
    return Prior(math.log(float(options.focal_prior) / finding.side), PRIOR_SIGMA["given"])


def disagreement(z: float, options: CalibrationOptions) -> str | None:
    """What to say of a prior that is ``z`` standard errors from the picture; None where that is near enough."""
    if not abs(z) > PRIOR_DISAGREES:
        return None
    known = f"focal_prior={options.focal_prior}"
    return f"the focal length by {known} and the picture disagree by {abs(z):.1f} standard errors"


def use_prior(finding: Finding, options: CalibrationOptions) -> None:
    """Fuse a photo's camera with the prior of its focal length; one that is not used may still cast doubt."""
    prior = focal_prior(finding, options)
    known = finding.photo.exif_focal_px
    if prior is None:
        if options.focal_prior == "exif":
            finding.doubts.append((0, "EXIF tells no focal length: none was used"))
        elif known:
            low, high = focal_interval(finding, "95")
            if not low <= known <= high:
                finding.doubts.append((1, f"EXIF tells a focal length of {known:.0f} px, outside the 95 % interval"))
        return
    values, sigmas = estimate(finding)
    if not np.isfinite(sigmas).all():
        finding.doubts.append((2, "the focal length of the prior was not used: the network gives no interval"))
        return
    fusion = with_prior(fuse(values[None], sigmas[None]), 0, prior)
    adopt(finding, fusion, f"focal_prior={options.focal_prior}, normal")
    if text := disagreement(fusion.prior_z, options):
        finding.doubts.append((1, text))
