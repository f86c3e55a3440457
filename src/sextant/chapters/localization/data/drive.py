"""One drive: a robot's images and odometry, frame by frame, with the ground truth."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from sextant.chapters.localization.data.motions import compose_over
from sextant.chapters.places.data import ImageRows

#: where the motions of a drive come from
Odometry = Literal["none", "simulated", "measured"]


@dataclass(frozen=True, eq=False)
class Drive:
    """One drive under one condition; frames are counted from 0.

    Attributes:
        name: of the drive, unique in the dataset.
        condition: season, weather or light.
        poses: ground truth: x, y (metres, or frames along a railway) and heading in rad, counter-clockwise from x.
        motion: odometry, as increments ``b_from_c`` in the robot's frame: row ``i`` leads from frame ``i - 1`` to frame
            ``i``, row 0 is zero, and a row of nan is missing. None if there is no odometry at all.
        images: one per frame, read when indexed; or None.
        seen: frames whose image and scan may be used.
        frames: number of each frame in its drive of the dataset, which indexes what was computed for all images of that
            drive. A fault may repeat or reorder frames.
        laser: ranges in metres, or None.
        times_s: increasing times in seconds, or None.
        kidnaps: frames at which the robot was kidnapped: it is not where odometry says, and nothing reports it.
        odometry: where ``motion`` comes from.
        corruption: key of the image corruption, such as ``fog/3``; empty for images as they are.
    """

    name: str
    condition: str
    poses: Float64[ndarray, "n 3"]
    motion: Float64[ndarray, "n 3"] | None
    images: ImageRows | None
    seen: Bool[ndarray, "n"]
    frames: Int64[ndarray, "n"]
    laser: Float32[ndarray, "n beams"] | None = None
    times_s: Float64[ndarray, "n"] | None = None
    kidnaps: tuple[int, ...] = ()
    odometry: Odometry = "none"
    corruption: str = ""

    def __post_init__(self) -> None:
        columns = (self.poses, self.motion, self.images, self.seen, self.frames, self.laser, self.times_s)
        lengths = {len(column) for column in columns if column is not None}
        if len(lengths) > 1:
            raise ValueError(f"columns of different lengths: {sorted(lengths)}")
        if not np.isfinite(self.poses).all():
            raise ValueError("poses must be finite")
        if any(not 0 < frame < len(self) for frame in self.kidnaps):
            raise ValueError(f"kidnaps={self.kidnaps} of a drive of {len(self)} frames")

    def __len__(self) -> int:
        return len(self.poses)

    @classmethod
    def of(
        cls,
        name: str,
        condition: str,
        poses: Float64[ndarray, "n 3"],
        *,
        motion: Float64[ndarray, "n 3"] | None = None,
        images: ImageRows | None = None,
        laser: Float32[ndarray, "n beams"] | None = None,
        times_s: Float64[ndarray, "n"] | None = None,
        odometry: Odometry = "none",
    ) -> "Drive":
        """A drive without faults: all frames are seen, and the robot is not kidnapped."""
        seen, frames = np.ones(len(poses), bool), np.arange(len(poses))
        return cls(name, condition, poses, motion, images, seen, frames, laser, times_s, odometry=odometry)

    def select(self, start: int = 0, stop: int | None = None, step: int = 1) -> "Drive":
        """Every ``step``-th frame of a stretch; motions over skipped frames are composed.

        A kidnap between two kept frames is moved to the later one. The first kept frame starts the drive: how the robot
        came there no longer matters.

        Raises:
            ValueError: no frame is left, or ``step`` is less than 1.
        """
        if step < 1:
            raise ValueError(f"step={step} must be at least 1")
        rows = np.arange(len(self))[start:stop:step]
        if not len(rows):
            raise ValueError(f"no frame of {len(self)} is in [{start}, {stop})")
        motion = None if self.motion is None else compose_over(self.motion, rows)
        kept = {int(np.searchsorted(rows, frame)) for frame in self.kidnaps if rows[0] < frame <= rows[-1]}
        return replace(self.take(rows), motion=motion, kidnaps=tuple(sorted(kept)))

    def take(self, rows: Int64[ndarray, "k"]) -> "Drive":
        """Frames in any order, possibly repeated or left out; without motions and kidnaps, which depend on the order.

        Times are kept if they still increase.
        """
        times_s = self.times_s if np.all(np.diff(rows) > 0) else None
        return replace(
            self,
            poses=self.poses[rows],
            motion=None,
            images=None if self.images is None else self.images.select(rows),
            seen=self.seen[rows],
            frames=self.frames[rows],
            laser=None if self.laser is None else self.laser[rows],
            times_s=None if times_s is None else times_s[rows],
            kidnaps=(),
        )

    def renumbered(self) -> "Drive":
        """The same frames as a drive of its own, counted from 0."""
        return replace(self, frames=np.arange(len(self)))
