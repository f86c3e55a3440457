"""One drive: a robot's images and odometry, frame by frame, with the ground truth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from sextant.chapters.places.data import ImageRows
from sextant.correspondence.pinhole import Pinhole
from sextant.geometry.planar import se2_between, se2_compose
from sextant.worlds.laser import LaserScanner


def between(a: Float64[ndarray, "n 3"], b: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """``A⁻¹ B`` of poses: the pose of b relative to a.

    Row ``i`` of the motions of a drive is ``b_from_c`` with b the pose of frame ``i - 1`` and c that of frame ``i``, so
    that ``pose[i] = pose[i-1] ∘ motion[i]``; row 0 is zero. A row of nan is a motion that was not measured.
    """
    return _numpy(se2_between(_torch(a), _torch(b)))


def compose(a: Float64[ndarray, "n 3"], b: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """``A B``: the motion a followed by the motion b."""
    return _numpy(se2_compose(_torch(a), _torch(b)))


def motions_along(poses: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """The motions between consecutive poses, as ``Localizer.step`` takes them; the first is zero.

    Args:
        poses: x and y in metres and headings in rad, counter-clockwise, in any frame of reference.

    Example:
        >>> motions_along(np.array([[0, 0, 0], [2, 0, np.pi / 2], [2, 1, np.pi / 2]])).round(2)
        array([[0.  , 0.  , 0.  ],
               [2.  , 0.  , 1.57],
               [1.  , 0.  , 0.  ]])
    """
    return np.concatenate([np.zeros((min(1, len(poses)), 3)), between(poses[:-1], poses[1:])])


def compose_over(motion: Float64[ndarray, "n 3"], rows: Int64[ndarray, "k"]) -> Float64[ndarray, "k 3"]:
    """The motions between some of the frames, composed over the frames left out between them.

    Args:
        motion: of a drive.
        rows: the frames that are kept, in increasing order.
    """
    before, gap = rows[:-1], np.diff(rows)
    total = motion[before + 1]
    for further in range(2, int(gap.max(initial=1)) + 1):
        longer = gap >= further
        total[longer] = compose(total[longer], motion[before[longer] + further])
    return np.concatenate([np.zeros((1, 3)), total])


def _torch(poses: ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(poses, np.float64))


def _numpy(poses: torch.Tensor) -> ndarray:
    return np.asarray(poses.numpy())


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
        frames: number of each frame in its drive of the dataset, which indexes results computed for all images of
            that drive. A fault may repeat or reorder frames.
        laser: ranges in metres, or None.
        times_s: increasing times in seconds, or None.
        kidnaps: frames at which the robot was kidnapped: odometry does not include its displacement.
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
        """A drive without faults: all frames may be used, and the robot is not kidnapped."""
        seen, frames = np.ones(len(poses), bool), np.arange(len(poses))
        return cls(name, condition, poses, motion, images, seen, frames, laser, times_s, odometry=odometry)

    def select(self, start: int = 0, stop: int | None = None, step: int = 1) -> "Drive":
        """Every ``step``-th frame of a stretch; motions over skipped frames are composed.

        A kidnap between two kept frames is moved to the later one. One at or before the first kept frame
        is dropped, as that frame starts the drive.

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


ProtocolName = Literal["office", "town", "railway"]


@dataclass(frozen=True, eq=False)
class LocalizationData:
    """Drives with poses in one frame. The frames of each are counted from 0: ``frames`` is ``0, 1, 2, ...``.

    Attributes:
        map: images at known poses.
        test: drives to localize in ``map``.
        validation: drives on which temperatures and noise are fitted; none of their frames is in ``test``.
        validation_map: the map in which ``validation`` is localized; None if that is ``map``.
        unit: of x and y; ``frames`` along a railway, where y and heading are zero.
        protocol: the rules by which success is judged.
        fit_map: images that the descriptor and the kernel are fitted to; None if those are ``map``.
        scanner: the one that made the laser scans, or None.
        other_maps: the route of ``map`` under other conditions. They may be the drives of ``test``.
        corrupted: the drives of ``test`` under image corruptions, which are localized too.
        camera: of all images, level and looking ahead; None if it is unknown.
        notes: notes on the results: files left out, missing odometry.
    """

    map: Drive
    test: tuple[Drive, ...]
    validation: tuple[Drive, ...]
    validation_map: Drive | None
    unit: Literal["m", "frames"]
    protocol: ProtocolName
    scanner: LaserScanner | None = None
    fit_map: Drive | None = None
    other_maps: tuple[Drive, ...] = ()
    notes: tuple[str, ...] = ()
    corrupted: tuple[Drive, ...] = ()
    camera: Pinhole | None = None

    @property
    def fitted(self) -> Drive:
        """The images that the descriptor and the kernel are fitted to."""
        return self.map if self.fit_map is None else self.fit_map

    @property
    def map_of_validation(self) -> Drive:
        """The map in which ``validation`` is localized."""
        return self.map if self.validation_map is None else self.validation_map

    def __post_init__(self) -> None:
        names = [drive.name for drive in (*self.test, *self.corrupted, *self.validation)]
        if len(set(names)) < len(names):
            raise ValueError(f"drives need distinct names: {names}")


def first_share(drives: Sequence[Drive], share: float) -> tuple[tuple[Drive, ...], tuple[Drive, ...]]:
    """The first ``share`` of each drive for validation, and the rest for the test.

    Each part has at least one frame.

    Raises:
        ValueError: ``share`` is not within (0, 1), or a drive has fewer than two frames.
    """
    if not 0 < share < 1:
        raise ValueError(f"share={share} must be within (0, 1)")
    if any(len(drive) < 2 for drive in drives):
        raise ValueError("a drive to split needs two frames")
    cuts = [min(max(1, round(share * len(drive))), len(drive) - 1) for drive in drives]
    parts = [(drive.select(0, cut), drive.select(cut).renumbered()) for drive, cut in zip(drives, cuts, strict=True)]
    return tuple(replace(early, name=f"{early.name}/start") for early, _ in parts), tuple(late for _, late in parts)
