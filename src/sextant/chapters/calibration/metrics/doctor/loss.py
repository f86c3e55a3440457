"""Checks of the bearing loss: closed forms, and cross-talk between its numbers."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from numpy import ndarray
from scipy.optimize import least_squares
from torch import Tensor

from sextant.chapters.calibration.metrics.doctor.finding import DOUBLE, Finding, random_cameras
from sextant.geometry import CameraParameters, Parameterization
from sextant.losses.camera_losses import bearing_difference, bearing_grid, world_bearings

#: tilt, roll, focal and k1 of the camera whose losses are examined, as in the design's table
TRUTH = (math.radians(8), math.radians(5), 0.8, -0.2)
WRONG = {
    "vfov +5 deg": (2, math.radians(5)),
    "vfov -5 deg": (2, math.radians(-5)),
    "k1_hat +0.1": (3, 0.1),
    "rho +0.05": (0, 0.05),
}


@dataclass(frozen=True)
class CrossTalk:
    """How the other three numbers compensate when one is wrong and they minimise the loss.

    Attributes:
        wrong: the number and its error.
        before_deg: root mean square bearing difference with the others true, degrees.
        after_deg: the same after the others minimise the joint loss.
        joint: the resulting changes of rho, roll, vfov and k1_hat, with 0 for the wrong one.
        disentangled: the same under the disentangled loss.
    """

    wrong: str
    before_deg: float
    after_deg: float
    joint: tuple[float, ...]
    disentangled: tuple[float, ...]


def closed_forms(count: int = 200, error: float = 0.3) -> list[Finding]:
    """Bearing differences caused by one wrong number, against their closed forms."""
    space = Parameterization("direct")
    truth = random_cameras(count, 4)
    grid = bearing_grid(7, torch.full((count,), 4 / 3, dtype=DOUBLE))
    level = CameraParameters(truth.tilt * 0, truth.roll * 0, truth.focal, truth.k1)
    rays, across = world_bearings(level, space, grid), world_bearings(truth, space, grid)[..., 0]

    def off_axis(camera: CameraParameters) -> Tensor:
        inside = world_bearings(camera._replace(tilt=truth.tilt * 0, roll=truth.roll * 0), space, grid)
        return torch.atan2(inside[..., :2].norm(dim=-1), inside[..., 2])

    def turned(angle: float | Tensor) -> Tensor:
        return 4 * torch.sin(torch.as_tensor(angle, dtype=DOUBLE) / 2) ** 2

    wrong = {
        "roll": (truth._replace(roll=truth.roll + error), turned(error) * (1 - rays[..., 2] ** 2)),
        "tilt": (truth._replace(tilt=truth.tilt + error), turned(error) * (1 - across**2)),
    }
    for name, other in (("focal", truth._replace(focal=truth.focal * 1.2)), ("k1", truth._replace(k1=truth.k1 + 0.1))):
        wrong[name] = (other, turned(off_axis(other) - off_axis(truth)))
    findings = []
    for name, (camera, expected) in wrong.items():
        found = bearing_difference(space.encode(camera), space.encode(truth), space, grid)
        findings.append(
            Finding("bearing loss", f"{name} error: closed form", (found - expected.mean(-1)).abs().max().item(), 1e-12)
        )
    return findings


def cross_talk(grid: int = 7, aspect: float = 4 / 3) -> list[CrossTalk]:
    """For each wrong number, the other three at the minimum of the joint and of the disentangled loss.

    Both are minimised by nonlinear least squares from a start near the truth, in the numbers rho, roll, vfov, k1_hat.

    Example:
        >>> row = cross_talk()[0]
        >>> row.wrong, round(row.before_deg, 2), round(row.after_deg, 2)
        ('vfov +5 deg', 2.55, 1.36)
        >>> round(row.joint[3], 2), abs(row.disentangled[3]) < 1e-7  # k1_hat makes up for it
        (0.11, True)
    """
    space = Parameterization("horizon")
    truth = space.encode(CameraParameters(*torch.tensor(TRUTH, dtype=DOUBLE)))
    points = bearing_grid(grid, torch.tensor(aspect, dtype=DOUBLE))
    aim = world_bearings(space.decode(truth), space, points)

    def joint(numbers: Tensor) -> Tensor:
        return (world_bearings(space.decode(numbers), space, points) - aim) / grid

    def disentangled(numbers: Tensor) -> Tensor:
        alone = torch.where(torch.eye(4, dtype=torch.bool), numbers, truth)
        return (world_bearings(space.decode(alone), space, points[None]) - aim) / (2 * grid)

    table = []
    for wrong, (number, error) in WRONG.items():
        others = torch.arange(4) != number
        before = truth + torch.where(others, 0, error)
        after, apart = (_compensated(residual, truth, number, error) for residual in (joint, disentangled))
        table.append(
            CrossTalk(
                wrong,
                math.degrees(joint(before).norm().item()),
                math.degrees(joint(after).norm().item()),
                tuple(torch.where(others, after - truth, 0).tolist()),
                tuple(torch.where(others, apart - truth, 0).tolist()),
            )
        )
    return table


def _compensated(residual: Callable[[Tensor], Tensor], truth: Tensor, number: int, error: float) -> Tensor:
    """The numbers that minimise the residual when one of them is wrong by ``error``."""
    free = [i for i in range(4) if i != number]

    def numbers(chosen: ndarray) -> Tensor:
        out = truth.clone()
        out[number] += error
        out[free] = torch.from_numpy(chosen)
        return out

    start = truth[free].numpy() + 0.02
    solution = least_squares(
        lambda chosen: residual(numbers(chosen)).flatten().numpy(), start, "3-point", xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    return numbers(solution.x)


def cross_talk_findings(table: list[CrossTalk]) -> list[Finding]:
    """Check that the joint loss is biased and the disentangled loss is not."""
    findings = []
    for row in table:
        sizes = [max(abs(value) for value in values) for values in (row.joint, row.disentangled)]
        findings.append(Finding("cross-talk", f"{row.wrong}: joint bias, at least", sizes[0], math.inf, 0.01))
        findings.append(Finding("cross-talk", f"{row.wrong}: disentangled bias", sizes[1], 1e-7))
    return findings
