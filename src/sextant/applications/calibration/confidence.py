"""How far a camera can be trusted, and why not further."""

import math
from collections.abc import Mapping
from typing import get_args

import numpy as np
import torch

from sextant.applications.calibration.finding import Finding
from sextant.applications.calibration.photo_camera import Verdict
from sextant.geometry import CameraParameters, focal_from_vfov, vfov_from_focal
from sextant.tasks.calibration.network import CameraNetwork

GOOD, TRUSTWORTHY = 0.5, 1.0  # half-width of a 68 % interval, in half-widths of the central 68 % trained on
NAMES = ("tilt", "roll", "field of view", "apparent distortion")
#: of a range: the cameras trained on end at :data:`ENDS`, for a range is a little wider than they spread
EDGE, ENDS = 0.01, 0.02 / 1.04
#: what the four numbers are, whatever the parameterization
NUMBERS = ("vertical position of the horizon or tilt", "roll", "size", "distortion")


def confidence(finding: Finding, network: CameraNetwork) -> tuple[Verdict, tuple[str, ...], Mapping[str, float]]:
    """A verdict, its reasons, and the widths of the 68 % intervals over the spread of the cameras trained on.

    The verdict is the worst of the widths, the finding's doubts, and of the range: an interval as wide as the spread of
    the cameras trained on says no more than was known before training.
    """
    spread, half = network.spec.spread, finding.half["68"]
    ratios = half / np.asarray(spread)
    worst, reasons = 0, []
    for i, (name, ratio) in enumerate(zip(NAMES, ratios, strict=True)):
        if ratio > GOOD:
            worst = max(worst, 2 if ratio > TRUSTWORTHY else 1)
            turn, unit = (180 / math.pi, "°") if i < 3 else (1.0, "")
            wider = "wider than the" if ratio > TRUSTWORTHY else "more than half of the"
            reasons.append(
                f"{name}: 68 % interval ±{half[i] * turn:.2g}{unit}, {wider} ±{spread[i] * turn:.2g}{unit} of all "
                "cameras trained on"
            )
    for allowed, text in (*finding.doubts, *_range_doubts(finding, network)):
        worst = max(worst, allowed)
        reasons.append(text)
    return get_args(Verdict)[worst], tuple(reasons), dict(zip(NAMES, ratios.tolist(), strict=True))


def _range_doubts(finding: Finding, network: CameraNetwork) -> list[tuple[int, str]]:
    """What speaks against a camera at the end of the range trained on, or near it for how sure it is.

    A network answers within the range of cameras trained on alone: what lies beyond an end is reported as something
    before it, and the nearer the end, the surer: no camera trained on could be far off there. So an angle is doubted
    where its 95 % interval reaches beyond the end. Distortion is not: most lenses have none, which is the end of most
    ranges.
    """
    doubts = []
    aspect = torch.tensor([finding.view.aspect], dtype=torch.float64)
    position = network.position(_stacked(finding.camera), aspect)[0].tolist()
    if at := [name for name, p in zip(NUMBERS, position, strict=True) if not EDGE <= p <= 1 - EDGE]:
        names = ", ".join(at)
        doubts.append((1, f"at the end of what the network was trained on: {names}; the truth may lie beyond"))
    ends = network.position(_interval_ends(finding), aspect).double()
    reached = [
        name
        for i, name in enumerate(NAMES[:3])
        if NUMBERS[i] not in at and not all(ENDS <= float(ends[k, i]) <= 1 - ENDS for k in (2 * i, 2 * i + 1))
    ]
    if reached:
        names = ", ".join(reached)
        doubts.append((1, f"the 95 % interval reaches beyond what the network was trained on: {names}"))
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
