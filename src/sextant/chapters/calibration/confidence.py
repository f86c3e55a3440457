"""Verdicts on estimated cameras, with their reasons."""

import math
from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.calibration.finding import Doubt, Finding
from sextant.chapters.calibration.network import CameraNetwork
from sextant.chapters.calibration.other_networks import OtherNetwork
from sextant.chapters.calibration.photo_camera import Intervals, PhotoCamera, Verdict
from sextant.chapters.calibration.verdict_probabilities import NUMBERS as RATED
from sextant.chapters.calibration.verdict_probabilities import RIGHT, WRONG, fitted_verdicts
from sextant.geometry import CameraParameters, focal_from_vfov, vfov_from_focal

GOOD, TRUSTWORTHY = 0.5, 1.0  # half-width of a 68 % interval, in half-widths of the central 68 % of training cameras
#: absolute limits for a camera from all evidence, to which the training spread does not apply: tilt and roll in
#: radians, relative focal length, and k1_hat in longer sides (0.1 and 0.3 in heights of 4:3)
JOINTLY_GOOD = (math.radians(3), math.radians(2), 0.1, 0.18)
JOINTLY_TRUSTWORTHY = (math.radians(10), math.radians(6), 0.25, 0.53)
#: share of the network's own interval above which an interval from all evidence is taken to rest on the network
LEANS = 0.5
#: probability of not being wrong below which a camera is not trustworthy: it is more likely wrong than not
UNLIKELY = 0.5
NAMES = ("tilt", "roll", "field of view", "apparent distortion")
#: shares at each end of a range that raise doubts; the training cameras end at :data:`ENDS`, since a range is slightly
#: wider than their spread
EDGE, ENDS = 0.01, 0.02 / 1.04
#: names of the four numbers, whatever the parameterization
NUMBERS = ("vertical position of the horizon or tilt", "roll", "size", "distortion")


def confidence(
    finding: Finding, network: CameraNetwork | OtherNetwork
) -> tuple[Verdict, tuple[str, ...], Mapping[str, float]]:
    """A verdict, its reasons, and the widths of the 68 % intervals over the spread of the training cameras.

    For the joint camera of one photo by itself, the verdict is by the fitted probabilities that the camera is right and
    that it is wrong (:mod:`~sextant.chapters.calibration.verdict_probabilities`). Otherwise it is the worst of those by
    the widths of the intervals. For the network alone, an interval as wide as the spread of the training cameras is
    uninformative, so widths are relative to that spread. For all evidence, and for a network of others, they are
    absolute. Doubts and the training range limit it, unless the probabilities account for them.
    """
    modelled = finding.joint is not None
    worst, reasons = _by_probabilities(finding) if modelled else (0, [])
    spread = None if isinstance(network, OtherNetwork) else network.spec.spread
    besides, told = beside_probabilities(finding, network) if modelled else _by_widths(finding, network, NAMES)
    doubts = _doubts(finding, network)
    if not modelled:
        besides = max([besides, *(doubt.allows for doubt in doubts)])
    half = finding.half["68"]
    ratios = {} if spread is None else dict(zip(NAMES, (half / np.asarray(spread)).tolist(), strict=True))
    said = (*reasons, *told, *(doubt.reason for doubt in doubts))
    return get_args(Verdict)[max(worst, besides)], said, ratios


def beside_probabilities(finding: Finding, network: CameraNetwork | OtherNetwork) -> tuple[int, list[str]]:
    """The best verdict allowed by what the fitted probabilities do not account for, and a distortion that is too wide.

    This is 0 for good, 1 for weak, 2 for not trustworthy.
    """
    worst, reasons = _by_widths(finding, network, NAMES[3:])
    return max([worst, *(doubt.allows for doubt in _doubts(finding, network) if not doubt.modelled)]), reasons


def _doubts(finding: Finding, network: CameraNetwork | OtherNetwork) -> list[Doubt]:
    doubts = list(finding.doubts)
    if finding.trusts_network:
        doubts += finding.network_doubts
        doubts += [] if isinstance(network, OtherNetwork) else _range_doubts(finding, network)
    return doubts


def _by_probabilities(finding: Finding) -> tuple[int, list[str]]:
    """The verdict by the fitted model of errors, and what it rests on if it is not the best."""
    model = fitted_verdicts()
    right, possible = model.of(finding, RIGHT), model.of(finding, WRONG)
    if possible.prod() < UNLIKELY:
        chances, limits, verdict = possible, WRONG, 2
    elif right.prod() < model.good:
        chances, limits, verdict = right, RIGHT, 1
    else:
        return 0, []
    most = max(UNLIKELY if verdict == 2 else model.good, chances.min())
    within = [
        f"{math.degrees(limits[0]):.0f}°",
        f"{math.degrees(limits[1]):.0f}°",
        f"{100 * math.expm1(limits[2]):.0f} %",
    ]
    told = zip(RATED, within, chances, strict=True)
    return verdict, [f"{name}: within {limit} with a probability of {p:.0%}" for name, limit, p in told if p <= most]


def _by_widths(finding: Finding, network: CameraNetwork | OtherNetwork, names: Sequence[str]) -> tuple[int, list[str]]:
    """The verdict by the widths of the 68 % intervals of the named numbers, and those that are too wide."""
    spread = None if isinstance(network, OtherNetwork) else network.spec.spread
    half, worst, reasons = finding.half["68"], 0, []
    for i, (name, good, most) in enumerate(zip(NAMES, *_allowed(finding, network), strict=True)):
        if name not in names or half[i] <= good:
            continue
        if not math.isfinite(half[i]):
            worst = 2
            reasons.append(f"{name}: the 68 % interval is unbounded")
            continue
        worst = max(worst, 1 if half[i] <= most else 2)
        turn, unit = (180 / math.pi, "°") if i < 3 else (1.0, "")
        limit, of = (good if half[i] <= most else most), ""
        if finding.network is None and spread is not None:
            limit, of = spread[i], " of all cameras trained on"
        width, wider = _distinct(half[i] * turn, limit * turn)
        part = "" if not of else "half of the " if half[i] <= most else "the "
        reasons.append(f"{name}: 68 % interval ±{width}{unit}, wider than {part}±{wider}{unit}{of}")
    return worst, reasons


def _distinct(a: float, b: float) -> tuple[str, str]:
    """Two numbers with the fewest digits, at least two, that distinguish them."""
    shown = ((f"{a:.{digits}g}", f"{b:.{digits}g}") for digits in range(2, 18))
    return next((pair for pair in shown if pair[0] != pair[1]), (f"{a:.2g}", f"{b:.2g}"))


def _allowed(
    finding: Finding, network: CameraNetwork | OtherNetwork
) -> tuple[Float64[ndarray, "4"], Float64[ndarray, "4"]]:
    """Half widths of 68 % intervals up to which a camera is good, and up to which it is trustworthy."""
    if finding.network is None and not isinstance(network, OtherNetwork):
        spread = np.asarray(network.spec.spread)
        return GOOD * spread, TRUSTWORTHY * spread
    focal = float(finding.camera.focal)
    longer = finding.side / finding.view.height
    units = np.array([1, 1, 4 * focal / (4 * focal**2 + 1), longer**-2])  # |d vfov / d ln f|
    return np.asarray(JOINTLY_GOOD) * units, np.asarray(JOINTLY_TRUSTWORTHY) * units


def _range_doubts(finding: Finding, network: CameraNetwork) -> list[Doubt]:
    """Doubts about a camera at the end of the training range, or too near it for its interval.

    A network predicts only within its training range. A camera beyond an end is predicted just inside it, and the
    expected error shrinks towards the end, since no training camera could be far off there. So an angle is doubted
    where its 95 % interval crosses the end. Distortion is not: most lenses have none, which is the end of most ranges.
    Nor is any quantity that the lines of the photo determine.
    """
    said, doubts = finding.network or finding, []
    own = finding.alone or finding.half
    leaning = own["68"] > (LEANS * said.half["68"] if finding.network else -1.0)
    aspect = torch.tensor([finding.view.aspect], dtype=torch.float64)
    position = network.position(_stacked(said.camera), aspect)[0].tolist()
    placed = zip(NUMBERS, position, leaning, strict=True)
    if at := [name for name, p, leans in placed if leans and not EDGE <= p <= 1 - EDGE]:
        names = ", ".join(at)
        at_end = f"at the end of the network's training range: {names}; the true value may lie beyond it"
        doubts.append(Doubt(1, at_end, modelled=True))
    ends = network.position(_interval_ends(said), aspect).double()
    reached = [
        name
        for i, name in enumerate(NAMES[:3])
        if leaning[i]
        and NUMBERS[i] not in at
        and not all(ENDS <= float(ends[k, i]) <= 1 - ENDS for k in (2 * i, 2 * i + 1))
    ]
    if reached:
        names = ", ".join(reached)
        beyond = f"the 95 % interval extends beyond the network's training range: {names}"
        doubts.append(Doubt(1, beyond, modelled=True))
    return doubts


def _stacked(*cameras: CameraParameters) -> CameraParameters:
    return CameraParameters(*(torch.stack(values) for values in zip(*cameras, strict=True)))


def _interval_ends(finding: Finding) -> CameraParameters:
    """The camera with tilt, roll and field of view in turn at the low and high end of their intervals."""
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


def photo_camera(finding: Finding, network: CameraNetwork | OtherNetwork) -> PhotoCamera:
    """The camera of a photo with its intervals and verdict."""
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
        probability_right=None if finding.joint is None else float(fitted_verdicts().of(finding, RIGHT).prod()),
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
