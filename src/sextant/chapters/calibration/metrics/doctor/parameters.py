"""Checks of the four numbers that a network predicts: round trips, the horizon's foot, and apparent distortion."""

import math

import torch

from sextant.chapters.calibration.metrics.doctor.finding import DOUBLE, Finding, random_cameras
from sextant.geometry import (
    Parameterization,
    PerspectiveCamera,
    heights_from_pixels,
    horizon_foot,
    horizon_points,
    k2_of_k1,
    max_radius,
    perspective_bearings,
    perspective_project,
    rho_from_tilt,
)


def round_trips(count: int = 20_000) -> list[Finding]:
    """Errors of cameras encoded and decoded by each parameterization."""
    findings = []
    for name in ("direct", "horizon", "undistorted_horizon"):
        worst = 0.0
        for family in ("lopez", "zero"):
            space = Parameterization(name, family)
            truth = random_cameras(count)
            fold = torch.atan(max_radius(truth.k1, space.k2(truth.k1)))
            truth = truth._replace(tilt=torch.minimum(truth.tilt.abs(), 0.95 * fold).copysign(truth.tilt))
            back = space.decode(space.encode(truth))
            worst = max([worst, *((a - b).abs().max().item() for a, b in zip(truth, back, strict=True))])
        findings.append(Finding("round trip", f"{name}: error of {count:,} cameras", worst, 1e-10))
    return findings


def horizon_feet(count: int = 60) -> list[Finding]:
    """The foot of the distorted horizon against a search along the horizon as seen."""
    azimuths = torch.linspace(-1.5, 1.5, 4001, dtype=DOUBLE)
    truth = random_cameras(count, 3, max_tilt=1.0)
    worst = 0.0
    for tilt, roll, focal, k1 in zip(*truth, strict=True):
        camera = PerspectiveCamera.from_focal(focal, 64, 48, k1=k1)
        pixels, visible = horizon_points(camera, tilt, roll, azimuths)
        seen = heights_from_pixels(pixels[visible], 64, 48)
        foot = horizon_foot(rho_from_tilt(tilt, focal, k1, k2_of_k1(k1)), roll)
        worst = max(worst, (seen[seen.norm(dim=-1).argmin()] - foot).abs().max().item())
    return [Finding("horizon", f"foot point of {count} horizons, heights", worst, 1e-9)]


def bow(focal: float, k1: float) -> float:
    """Largest bow, in image heights, of a straight vertical edge that crosses the middle row at u = 0.5."""
    lens = torch.tensor(focal, dtype=DOUBLE), torch.tensor(k1, dtype=DOUBLE), k2_of_k1(torch.tensor(k1, dtype=DOUBLE))
    middle = perspective_bearings(torch.tensor([0.5, 0.0], dtype=DOUBLE), *lens)
    y = torch.linspace(0, 4, 8001, dtype=DOUBLE)
    seen, visible = perspective_project(torch.stack([(middle[0] / middle[2]).expand_as(y), y, y * 0 + 1], -1), *lens)
    return (0.5 - seen[visible & (seen[:, 1] <= 0.5), 0]).abs().max().item()


def bow_test() -> list[Finding]:
    """Equal apparent distortion bends lines equally whatever the focal length; equal k1 does not."""
    focals = (0.5, 0.7, 1.0, 1.4)
    apparent, plain = [bow(f, -0.2 * f * f) for f in focals], [bow(f, -0.2) for f in focals]
    spread = 100 * (max(apparent) / min(apparent) - 1)
    return [
        Finding("bow", "k1_hat = -0.2, f = 0.5 to 1.4: spread, %", spread, 9.0),
        Finding("bow", "k1 = -0.2, the same: largest by smallest", max(plain) / min(plain), math.inf, 4.0),
    ]
