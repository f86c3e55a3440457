"""The kidnapped robot."""

from dataclasses import dataclass, replace

import numpy as np

from sextant.data.localization.drive import Drive
from sextant.data.localization.faults.fault import Fault, frame_at
from sextant.data.localization.motions import compose_over
from sextant.errors import UserError


@dataclass(frozen=True)
class Kidnap(Fault):
    """At ``frame`` the drive continues from another of its frames, while odometry reports an ordinary step.

    That frame is drawn among those at least ``distance`` away with ``after`` frames left, so that drives of all seeds
    have the same length, ``frame + after``.

    Attributes:
        frame: number of the first frame after the kidnap, or its share of the drive if below 1.
        distance: smallest distance from where the robot would have been, in the dataset's unit.
        after: number of frames from the kidnap on; None for as many as were left. In that case, without a ``whole``
            drive to choose from, the robot is set back to a place where it has been.
    """

    frame: float | int = 0.5
    distance: float = 10.0
    after: int | None = None

    def __post_init__(self) -> None:
        if not self.frame > 0 or not self.distance >= 0 or (self.after is not None and self.after < 1):
            raise UserError(
                f"fault.frame={self.frame:g} must be positive, fault.distance={self.distance:g} not negative, and "
                f"fault.after={self.after} at least 1 or null"
            )

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """The drive up to the kidnap, followed by a stretch from elsewhere at the same pace."""
        pace = 1 if whole is None or len(drive) < 2 else int(drive.frames[1] - drive.frames[0])
        pool = drive if whole is None else whole
        here = frame_at(self.frame, drive, "fault.frame")
        after = len(drive) - here if self.after is None else self.after
        start = self._elsewhere(drive, here, pool, after, pace, rng)
        there = start + pace * np.arange(after)
        before = np.arange(here)
        motion = None
        if drive.motion is not None and pool.motion is not None:
            step = drive.motion[here : here + 1]  # what the wheels would have reported
            motion = np.concatenate([drive.motion[before], step, compose_over(pool.motion, there)[1:]])
        times = None
        if drive.times_s is not None and pool.times_s is not None:
            elapsed = pool.times_s[there] - pool.times_s[start]
            times = np.concatenate([drive.times_s[before], drive.times_s[here] + elapsed])
        # rows of the pool: a part is some frames of the whole
        early = before if whole is None else drive.frames[before]
        late = {int(np.searchsorted(there, frame)) for frame in pool.kidnaps if start < frame <= there[-1]}
        kidnaps = (*(frame for frame in drive.kidnaps if frame < here), here, *(here + k for k in sorted(late)))
        return replace(
            pool.take(np.concatenate([early, there])),
            motion=motion,
            times_s=times,
            kidnaps=kidnaps,
            seen=np.concatenate([drive.seen[before], pool.seen[there]]),
        )

    def _elsewhere(self, drive: Drive, here: int, pool: Drive, after: int, pace: int, rng: np.random.Generator) -> int:
        """A frame of the pool that is far enough away, with enough frames left."""
        apart = np.linalg.norm(pool.poses[:, :2] - drive.poses[here, :2], axis=1)
        enough = np.arange(len(pool)) + pace * (after - 1) < len(pool)
        there = np.flatnonzero((apart >= self.distance) & enough)
        if not len(there):
            raise UserError(
                f"fault=kidnap: no frame of {pool.name} is {self.distance:g} away from frame {here} and has {after} "
                f"of {len(pool)} frames left",
                f"For example fault.distance={apart.max() / 2:.3g} or fault.after={max(1, len(drive) // 4)}",
            )
        return int(rng.choice(there))
