"""Faulty maps."""

from dataclasses import dataclass, replace

import numpy as np

from sextant.data.localization.drive import Drive
from sextant.data.localization.faults.fault import Fault
from sextant.data.localization.localization_data import LocalizationData
from sextant.errors import ArgumentError, UserError


@dataclass(frozen=True)
class NoisyMapPoses(Fault):
    """Map poses are noisy, with errors ``N(0, position²)`` of x and y, and an error of the heading.

    Along a railway, where y and heading are zero for all images, only x errs.

    Attributes:
        position: standard deviation of x and of y in the dataset's unit.
        heading_deg: standard deviation of the heading.
    """

    position: float = 0.5
    heading_deg: float = 5.0

    def __post_init__(self) -> None:
        if not self.position >= 0 or not self.heading_deg >= 0:
            raise UserError(
                f"fault.position={self.position:g} and fault.heading_deg={self.heading_deg:g} must not be negative",
                "fault.position=0.5",
            )

    def map(self, map: Drive, rng: np.random.Generator) -> Drive:
        """The map with other poses."""
        sigma = np.array([self.position, self.position, np.radians(self.heading_deg)])
        if not map.poses[:, 1:].any():
            sigma[1:] = 0.0
        poses = map.poses + rng.normal(size=map.poses.shape) * sigma
        poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
        return replace(map, poses=poses)


@dataclass(frozen=True)
class ThinnedMap(Fault):
    """A map of a random share ``keep`` of the images: even steps would leave out whole viewing directions.

    At least one image is kept.
    """

    keep: float = 0.25

    def __post_init__(self) -> None:
        if not 0 < self.keep <= 1:
            raise UserError(f"fault.keep={self.keep:g} must be in (0, 1]", "fault.keep=0.25")

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
