"""All checks, in order."""

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


def examine(crop: Crop) -> tuple[list[Finding], list[loss.CrossTalk]]:
    """Run all checks, and compute the cross-talk table.

    Args:
        crop: cuts crops of a panorama.

    Example:
        >>> from sextant.chapters.calibration.data.crops import crop_panoramas
        >>> findings, table = examine(crop_panoramas)  # some seconds  # doctest: +SKIP
        >>> all(finding.passed for finding in findings)  # doctest: +SKIP
        True
    """
    findings = [finding for check in CHECKS for finding in check()]
    table = loss.cross_talk()
    findings += loss.cross_talk_findings(table) + crop_against_render(crop) + edge_in_crop(crop)
    return findings, table
