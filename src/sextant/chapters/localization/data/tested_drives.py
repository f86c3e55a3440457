"""Many runs along one drive, each from its own start frame and with its own fault."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.data.faults import Fault


@dataclass(frozen=True, eq=False)
class TestRuns:
    """Runs side by side, step by step. A run that ends before the last step stays at its end, unseen.

    Attributes:
        frames: frames of the drive, which index descriptors and scans.
        poses: ground truth.
        motion: odometry; nan where it is missing.
        seen: whether the frame may be used.
        lengths: number of steps of each run.
        kidnapped_at: the step at which each run is kidnapped; -1 for none.
    """

    __test__ = False  # not a test of pytest's

    frames: Int64[ndarray, "t r"]
    poses: Float64[ndarray, "t r 3"]
    motion: Float64[ndarray, "t r 3"]
    seen: Bool[ndarray, "t r"]
    lengths: Int64[ndarray, "r"]
    kidnapped_at: Int64[ndarray, "r"]

    @property
    def inside(self) -> Bool[ndarray, "t r"]:
        """Whether a step belongs to a run."""
        return np.asarray(np.arange(len(self.frames))[:, None] < self.lengths)


def lay_out_runs(drive: Drive, fault: Fault, starts: int, horizon: int, every: int, seed: int) -> TestRuns:
    """Runs that start at frames evenly spaced over a drive.

    Args:
        drive: the drive to localize.
        fault: put into each run, with random numbers of its own.
        starts: number of runs.
        horizon: steps of each run, or fewer if the drive ends. The last run starts early enough for ``horizon`` steps
            if the drive has that many.
        every: frames from one step to the next.
        seed: of the faults.
    """
    begins = np.round(np.linspace(0, max(0, len(drive) - horizon * every), starts)).astype(np.int64)
    runs = [_one(drive, fault, int(begin), horizon, every, [seed, 82, k]) for k, begin in enumerate(begins)]
    steps = max(len(run) for run, _ in runs)
    return TestRuns(
        _side_by_side([frames for _, frames in runs], steps),
        _side_by_side([run.poses for run, _ in runs], steps),
        _side_by_side([_motion(run) for run, _ in runs], steps, 0.0),
        _side_by_side([run.seen for run, _ in runs], steps, False),
        np.array([len(run) for run, _ in runs]),
        np.array([run.kidnaps[0] if run.kidnaps else -1 for run, _ in runs]),
    )


def _one(
    drive: Drive, fault: Fault, begin: int, horizon: int, every: int, seed: Sequence[int]
) -> tuple[Drive, Int64[ndarray, "t"]]:
    """One run with its fault, and the frames of the drive that it consists of."""
    run = fault.drive(drive.select(begin, begin + horizon * every, every), np.random.default_rng(seed), drive)
    return run, np.searchsorted(drive.frames, run.frames)


def _motion(run: Drive) -> ndarray:
    return np.full((len(run), 3), np.nan) if run.motion is None else run.motion


def _side_by_side(columns: Sequence[ndarray], steps: int, last: object = None) -> ndarray:
    """Stack columns side by side; shorter ones are padded with their last value, or with ``last``."""
    padded = []
    for column in columns:
        rest = np.repeat(column[-1:], steps - len(column), axis=0)
        padded.append(np.concatenate([column, rest if last is None else np.full_like(rest, last)]))
    return np.stack(padded, axis=1)
