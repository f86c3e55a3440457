"""Wrong or missing odometry."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.data.localization.drive import Drive
from sextant.data.localization.faults.fault import Fault, stretch_at
from sextant.errors import UserError


@dataclass(frozen=True)
class OdometryScale(Fault):
    """A wrong odometry scale: reported distances are ``factor`` times too long, and turns ``turn`` times too large."""

    factor: float = 1.1
    turn: float = 1.0

    def __post_init__(self) -> None:
        if not self.factor > 0 or not self.turn > 0:
            raise UserError(
                f"fault.factor={self.factor:g} and fault.turn={self.turn:g} must be positive", "fault.factor=1.1"
            )

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """The drive with scaled motions."""
        return replace(drive, motion=_motion(drive) * np.array([self.factor, self.factor, self.turn]))


@dataclass(frozen=True)
class OdometrySlip(Fault):
    """Wheels slip for ``length`` frames from ``frame`` on (a number, or a share of the drive if below 1).

    ``spinning``: the wheels turn while the robot stands still. It sees the previous frame repeatedly and then drives
    on, so that the drive becomes ``length`` frames longer. ``sliding``: the wheels stand still while the robot moves.
    """

    frame: float | int = 0.5
    length: int = 20
    kind: Literal["spinning", "sliding"] = "spinning"

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """The drive with motions that the robot did not make, or without some that it made."""
        stretch, motion = stretch_at(self.frame, self.length, drive, "fault"), _motion(drive)
        if self.kind == "sliding":
            still = motion.copy()
            still[stretch] = 0.0
            return replace(drive, motion=still)
        first = stretch.start
        rows = np.concatenate([np.arange(first), np.full(self.length, first - 1), np.arange(first, len(drive))])
        told = np.concatenate([motion[:first], motion[stretch], motion[first:]])
        times = None
        if drive.times_s is not None:  # the robot loses the time in which the wheels spun
            spun = drive.times_s[stretch] - drive.times_s[first - 1]
            times = np.concatenate(
                [drive.times_s[:first], drive.times_s[first - 1] + spun, drive.times_s[first:] + spun[-1]]
            )
        kidnaps = tuple(frame if frame < first else frame + self.length for frame in drive.kidnaps)
        return replace(drive.take(rows), motion=told, times_s=times, kidnaps=kidnaps)


@dataclass(frozen=True)
class MissingOdometry(Fault):
    """Odometry is missing for ``length`` frames from ``frame`` on (a number, or a share of the drive if below 1)."""

    frame: float | int = 0.5
    length: int = 10

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """The drive with motions of nan."""
        motion = _motion(drive).copy()
        motion[stretch_at(self.frame, self.length, drive, "fault")] = np.nan
        return replace(drive, motion=motion)


def _motion(drive: Drive) -> Float64[ndarray, "n 3"]:
    if drive.motion is None:
        raise UserError(f"{drive.name} has no odometry to corrupt", "fault=none")
    return drive.motion
