"""Drives through a town under several seasons, and through a city mapped in all directions."""

import numpy as np
from numpy import ndarray

from sextant.chapters.localization.data.drive import Drive, LocalizationData, first_share
from sextant.chapters.localization.data.simulated import CAR_WHEELS, DrivenWorld, simulated_motion
from sextant.chapters.places.data import ImageRows
from sextant.data.rendered.splits import RenderedSplit
from sextant.errors import ArgumentError

#: of each drive through the city
VALIDATION_SHARE = 0.2


class _TownSource(DrivenWorld):
    """A rendered town whose drives get a car's odometry."""

    def _drive(self, split: RenderedSplit, rows: ndarray, name: str, condition: str, *, moving: bool = True) -> Drive:
        poses = np.ascontiguousarray(split.columns["pose"][rows][:, [0, 1, 3]])
        scale, seed = self.settings.odometry_scale, self.settings.odometry_seed
        return Drive.of(
            name,
            condition,
            poses,
            motion=simulated_motion(poses, CAR_WHEELS, scale, seed, name) if moving else None,
            images=ImageRows(split.images, split.rows[rows]),
            odometry="simulated" if moving else "none",
        )


class TownSeasonsDrives(_TownSource):
    """The traverses of :class:`~sextant.data.worlds.TownSeasons`: the first condition's drive of a town is its map.

    The drives of the test town under the other conditions are for the test. Those of the validation town, which has its
    own map, are for validation.
    """

    def read(self) -> LocalizationData:
        """All drives, rendered first if necessary.

        Raises:
            UserError: there is no condition besides the map's.
        """
        conditions = self.conditions()
        if len(conditions) < 2:
            raise ArgumentError(
                f"conditions={list(conditions)}: the first is the map's, which leaves none to localize",
                "conditions=[summer_noon,winter_noon]",
            )
        first, *test = self._town("test", conditions)
        validation_map, *validation = self._town("val", conditions)
        return LocalizationData(
            first, tuple(test), tuple(validation), validation_map, "m", "town", other_maps=tuple(test)
        )

    def _town(self, split: str, conditions: tuple[str, ...]) -> list[Drive]:
        found = self.read_split(split, f"frames.{split}=300")
        drives = []
        for number, condition in enumerate(conditions):
            rows = np.flatnonzero(found.columns["condition"] == number)
            rows = rows[np.argsort(found.columns["place"][rows], kind="stable")]
            drives.append(self._drive(found, rows, f"{split}/{condition}", condition))
        return drives


class TownCityDrives(_TownSource):
    """The map of :class:`~sextant.data.worlds.TownCity`, and a drive under each condition.

    The first fifth of each drive is for validation, in the same map.
    """

    def read(self) -> LocalizationData:
        """All drives, rendered first if necessary; pictures stay in their file."""
        mapped = self.read_split("map", "images=172000")
        queries = self.read_split("query", "query_frames=1000")
        conditions = self.conditions()
        whole = np.arange(len(mapped.rows))
        drives = [
            self._drive(queries, np.flatnonzero(queries.columns["condition"] == number), condition, condition)
            for number, condition in enumerate(conditions)
        ]
        if min(len(drive) for drive in drives) < 2:
            frames = self.dataset.plan().config["query_frames"]
            raise ArgumentError(
                f"query_frames={frames} leaves none for validation or for the test", "query_frames=1000"
            )
        validation, test = first_share(drives, self.settings.share(VALIDATION_SHARE))
        first = self._drive(mapped, whole, "map", conditions[0], moving=False)
        return LocalizationData(first, test, validation, None, "m", "town")
