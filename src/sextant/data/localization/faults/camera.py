"""Images that do not arrive."""

from dataclasses import dataclass, replace

import numpy as np

from sextant.data.localization.drive import Drive
from sextant.data.localization.faults.fault import Fault, stretch_at
from sextant.errors import UserError


@dataclass(frozen=True)
class DroppedFrames(Fault):
    """Each image, with its scan, is lost with probability ``share``; odometry continues.

    The first frame is kept: a drive begins with an image.
    """

    share: float = 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise UserError(f"fault.share={self.share:g} must be in [0, 1]", "fault.share=0.5")

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """The drive with fewer frames ``seen``."""
        kept = rng.random(len(drive)) >= self.share
        kept[:1] = True
        return replace(drive, seen=drive.seen & kept)


@dataclass(frozen=True)
class Blackout(Fault):
    """No image arrives for ``length`` frames from ``frame`` on (a number, or a share of the drive if below 1)."""

    frame: float | int = 0.5
    length: int = 30

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """The drive with a stretch of frames that are not ``seen``."""
        seen = drive.seen.copy()
        seen[stretch_at(self.frame, self.length, drive, "fault")] = False
        return replace(drive, seen=seen)
