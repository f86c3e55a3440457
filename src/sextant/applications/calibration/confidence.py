"""How far a camera can be trusted, and why not further."""

import math
from typing import Any

import numpy as np

from sextant.applications.calibration.finding import VERDICTS, Finding
from sextant.applications.calibration.model import CalibrationModel
from sextant.applications.calibration.ranges import range_doubts

GOOD, TRUSTWORTHY = 0.5, 1.0  # half-width of a 68 % interval, in half-widths of the central 68 % trained on
NAMES = ("tilt", "roll", "field of view", "apparent distortion")


def confidence(finding: Finding, model: CalibrationModel) -> dict[str, Any]:
    """A verdict and its reasons: the worst of the widths of the intervals, the finding's doubts, and of the range.

    An interval as wide as the spread of the cameras trained on tells no more than that training knew.

    Args:
        finding: the camera.
        model: that told it.
    """
    spread = model.spread
    ratios = finding.half["68"] / np.asarray(spread)
    verdict, reasons = 0, []
    for i, (name, ratio) in enumerate(zip(NAMES, ratios, strict=True)):
        if ratio > GOOD:
            verdict = max(verdict, 2 if ratio > TRUSTWORTHY else 1)
            half, known, unit = finding.half["68"][i], spread[i], ""
            if i < 3:
                half, known, unit = math.degrees(half), math.degrees(known), "°"
            wider = "wider than the" if ratio > TRUSTWORTHY else "more than half of the"
            reasons.append(
                f"{name}: 68 % interval ±{half:.2g}{unit}, {wider} ±{known:.2g}{unit} of all cameras trained on"
            )
    for worst, text in [*finding.doubts, *range_doubts(finding, model)]:
        verdict = max(verdict, worst)
        reasons.append(text)
    return {"verdict": VERDICTS[verdict], "width_over_training_spread": dict(zip(NAMES, ratios.tolist(), strict=True)),
            "reasons": reasons}  # fmt: skip
