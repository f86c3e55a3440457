"""All checks, in order."""

import math

from sextant.chapters.calibration.metrics.doctor import lens, loss
from sextant.chapters.calibration.metrics.doctor.finding import Crop, Finding, crop_against_render, edge_in_crop

#: in the order shown
CHECKS = (
    lens.round_trips,
    lens.newton_against_bisection,
    lens.implicit_gradients,
    lens.fold_radius,
    lens.straightness,
    lens.against_opencv,
    lens.horizon_feet,
    lens.bow_test,
    loss.closed_forms,
)


def examine(
    crop: Crop | None, why_not: str = "no function that cuts crops was given"
) -> tuple[list[Finding], list[loss.CrossTalk]]:
    """Run all checks, and compute the cross-talk table.

    Args:
        crop: cuts crops of a panorama; None skips the checks that need it.
        why_not: why there is no such function.

    Example:
        >>> findings, table = examine(crop=None)  # some seconds  # doctest: +SKIP
        >>> all(finding.passed for finding in findings), findings[-1].skipped  # doctest: +SKIP
        (True, 'no function that cuts crops was given')
    """
    findings = [finding for check in CHECKS for finding in check()]
    table = loss.cross_talk()
    findings += loss.cross_talk_findings(table)
    if crop is None:
        findings.append(Finding("crop", "against the render", math.nan, 2.0, skipped=why_not))
    else:
        findings += crop_against_render(crop) + edge_in_crop(crop)
    return findings, table
