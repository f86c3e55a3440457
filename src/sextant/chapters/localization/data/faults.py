"""Faults of the robot, its camera, its wheels, or its map."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.drive import Drive, LocalizationData, compose_over
from sextant.errors import ArgumentError, UserError
from sextant.ranges import Count, NonNegative, Positive, checked
from sextant.tables import counted

__all__ = [
    "Blackout",
    "DroppedFrames",
    "Fault",
    "Kidnap",
    "MissingOdometry",
    "NoFault",
    "NoisyMapPoses",
    "OdometryScale",
    "OdometrySlip",
    "ThinnedMap",
    "WrongSeasonMap",
    "WrongStart",
]


class Fault:
    """A fault changes the drives that are localized, or their map; by default each method changes nothing.

    Arguments are never modified: new drives are returned.
    """

    def data(self, data: LocalizationData) -> LocalizationData:
        """Apply the fault to the choice of drives, before they are described.

        Raises:
            UserError: the dataset lacks what the fault needs.
        """
        return data

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """Apply the fault to a drive that is localized.

        Args:
            drive: a drive, or a part of it: a run that starts somewhere along it.
            rng: random generator for what is drawn.
            whole: the drive of the dataset that ``drive`` is a part of, by :meth:`Drive.select`: a robot may be
                kidnapped to any place of it; None for ``drive`` itself.

        Raises:
            UserError: the drive is too short for the fault.
        """
        return drive

    def map(self, map: Drive, rng: np.random.Generator) -> Drive:
        """Apply the fault to the map after its images were described; the images are those of the given map.

        Raises:
            UserError: the map is too small for the fault.
        """
        return map


@dataclass(frozen=True)
class NoFault(Fault):
    """No fault."""


def frame_at(frame: float | int, drive: Drive, key: str) -> int:
    """A frame given by its number, or as a share of the drive if below 1.

    Raises:
        UserError: the drive has no such frame, or it is the first.
    """
    number = round(frame * len(drive)) if frame < 1 else int(frame)
    if not 0 < number < len(drive):
        raise UserError(
            f"{key}={frame:g} is frame {number} of {drive.name}, which has {len(drive)}: it must be in "
            f"[1, {len(drive) - 1}]",
            f"{key}=0.5 is the middle of each drive",
        )
    return number


def stretch_at(frame: float | int, length: int, drive: Drive, name: str) -> slice:
    """``length`` frames from ``frame`` on.

    Raises:
        UserError: the drive ends earlier.
    """
    first = frame_at(frame, drive, f"{name}.frame")
    if length < 1 or first + length > len(drive):
        raise UserError(
            f"{name}.length={length} from frame {first} on: {drive.name} has {counted(len(drive), 'frame')}",
            f"{name}.length={max(1, len(drive) - first)} at most",
        )
    return slice(first, first + length)


@checked
@dataclass(frozen=True)
class DroppedFrames(Fault):
    """Each image, with its scan, is lost with probability ``share``; odometry continues.

    The first frame is kept: a drive begins with an image.
    """

    share: Annotated[float, Ge(0), Le(1)] = 0.5

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


@checked
@dataclass(frozen=True)
class Kidnap(Fault):
    """At ``frame`` the drive continues from another of its frames, while odometry reports an ordinary step.

    That frame is drawn among those at least ``distance`` away with ``after`` frames left, so that drives of all seeds
    have the same length, ``frame + after``.

    Attributes:
        frame: number of the first frame after the kidnap, or its share of the drive if below 1.
        distance: smallest distance from where the robot would have been, in the dataset's unit.
        after: number of frames from the kidnap on; None for as many as were left. In that case, without a ``whole``
            drive to choose from, only places that the robot has already passed have enough frames left.
    """

    frame: Positive = 0.5
    distance: NonNegative = 10.0
    after: Count | None = None

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
                f"of {counted(len(pool), 'frame')} left",
                f"For example fault.distance={apart.max() / 2:.3g} or fault.after={max(1, len(drive) // 4)}",
            )
        return int(rng.choice(there))


@checked
@dataclass(frozen=True)
class NoisyMapPoses(Fault):
    """Map poses are noisy, with errors ``N(0, position²)`` of x and y, and an error of the heading.

    Along a railway, where y and heading are zero for all images, only x is perturbed.

    Attributes:
        position: standard deviation of x and of y in the dataset's unit.
        heading_deg: standard deviation of the heading.
    """

    position: NonNegative = 0.5
    heading_deg: NonNegative = 5.0

    def map(self, map: Drive, rng: np.random.Generator) -> Drive:
        """The map with other poses."""
        sigma = np.array([self.position, self.position, np.radians(self.heading_deg)])
        if not map.poses[:, 1:].any():
            sigma[1:] = 0.0
        poses = map.poses + rng.normal(size=map.poses.shape) * sigma
        poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
        return replace(map, poses=poses)


@checked
@dataclass(frozen=True)
class ThinnedMap(Fault):
    """A map of a random share ``keep`` of the images; taking every k-th would drop whole viewing directions.

    At least one image is kept.
    """

    keep: Annotated[float, Gt(0), Le(1)] = 0.25

    def map(self, map: Drive, rng: np.random.Generator) -> Drive:
        """The smaller map; its rows are those of :meth:`rows`."""
        return map.take(self.rows(len(map), rng))

    def rows(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """The images that are kept, in their order."""
        return np.sort(rng.choice(count, max(1, round(self.keep * count)), replace=False))


@dataclass(frozen=True)
class WrongSeasonMap(Fault):
    """The map was made under another ``condition``.

    Drives of that same condition are left out of the test, since their images are the map's.
    """

    condition: str

    def data(self, data: LocalizationData) -> LocalizationData:
        """The data with another map."""
        others = {drive.condition: drive for drive in data.other_maps}
        if self.condition not in others:
            there = f"there is one under {', '.join(others)}" if others else "there is none"
            raise UserError(
                f"fault.condition={self.condition}: the dataset has no map under {self.condition}; {there}, "
                f"in addition to that under {data.map.condition}",
                "Choose among these, or give the conditions of the dataset in another order: the first is the map's.",
            )
        test = tuple(drive for drive in data.test if drive.condition != self.condition)
        if not test:
            raise ArgumentError(
                f"fault.condition={self.condition}: no drive of another condition is left to localize in that map",
                "Give the dataset a third condition: conditions=[...]",
            )
        corrupted = tuple(drive for drive in data.corrupted if drive.condition != self.condition)
        chosen = replace(others[self.condition], motion=None, odometry="none")
        return replace(data, map=chosen, test=test, other_maps=(data.map,), corrupted=corrupted)


@checked
@dataclass(frozen=True)
class WrongStart(Fault):
    """The filter starts around a pose that is ``distance`` and ``heading_deg`` away from the true one.

    Drives and map are left unchanged: the code that starts the filter reads these values.

    Attributes:
        distance: in the dataset's unit, in a direction drawn at random.
        heading_deg: to either side.
    """

    distance: NonNegative = 5.0
    heading_deg: Annotated[float, Ge(0), Le(180)] = 90.0


@checked
@dataclass(frozen=True)
class OdometryScale(Fault):
    """A wrong odometry scale: reported distances are ``factor`` times too long, and turns ``turn`` times too large."""

    factor: Positive = 1.1
    turn: Positive = 1.0

    def drive(self, drive: Drive, rng: np.random.Generator, whole: Drive | None = None) -> Drive:
        """The drive with scaled motions."""
        return replace(drive, motion=_motion(drive) * np.array([self.factor, self.factor, self.turn]))


@dataclass(frozen=True)
class OdometrySlip(Fault):
    """Wheels slip for ``length`` frames from ``frame`` on (a number, or a share of the drive if below 1).

    ``spinning``: the wheels turn while the robot stands still. The previous frame is repeated before the drive
    continues, so that it becomes ``length`` frames longer. ``sliding``: the wheels stand still while the robot moves.
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
        if drive.times_s is not None:  # the drive takes longer by the time that the wheels spun
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
