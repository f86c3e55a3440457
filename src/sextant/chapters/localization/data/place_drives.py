"""Traverses of place recognition as drives: along a railway, and the user's own folders."""

from pathlib import Path

import numpy as np
from numpy import ndarray

from sextant.chapters.localization.data.drive import Drive, LocalizationData, first_share
from sextant.chapters.localization.data.simulated import (
    CAR_WHEELS,
    DriveSettings,
    Split,
    simulated_motion,
    simulated_railway_motion,
)
from sextant.chapters.places.data import ImageRows, Nordland, PlaceFolders, PlaceImages
from sextant.errors import ArgumentError, UserError
from sextant.tables import counted

#: of each test drive, if there are no drives for validation
VALIDATION_SHARE = 0.25


class RailwayDrives:
    """Aligned traverses of one line: x is the number of the frame, y and heading are zero.

    The test frames of the first condition are the map, those of the other conditions the drives to localize. Validation
    frames of the other conditions are localized in a map of the training and validation frames of the first. Odometry
    is simulated: see :data:`~sextant.chapters.localization.data.simulated.FRAME_SIGMA`.
    """

    def __init__(self, dataset: Nordland, settings: DriveSettings | None = None):
        self.dataset, self.settings = dataset, settings or DriveSettings()
        self.name = dataset.name

    def conditions(self) -> tuple[str, ...]:
        """The seasons, the map's first."""
        return self.dataset.conditions("test")

    def files(self, split: Split) -> list[Path]:
        """The frames of a split; validation has a map of its own. Nothing is decoded."""
        if split == "validation":
            return [*self.dataset.files("train"), *self.dataset.files("val")]
        return self.dataset.files("test")

    def fingerprint(self) -> str:
        """Hash of the frames and of the settings."""
        return self.settings.identity(self.dataset.fingerprint())

    def read(self) -> LocalizationData:
        """All drives, decoded the first time.

        Raises:
            UserError: frames cannot be read, or there is no condition besides the map's.
        """
        conditions = _several(self.conditions())
        train, val, test = (self.dataset.read(split) for split in ("train", "val", "test"))
        first, *drives = [self._drive(test, condition, "test") for condition in conditions]
        learnt, own, *validation = [
            self._drive(train, conditions[0], "train"), *(self._drive(val, name, "val") for name in conditions)
        ]  # fmt: skip
        return LocalizationData(
            first,
            tuple(drives),
            tuple(validation),
            _joined(learnt, own),
            "frames",
            "railway",
            other_maps=tuple(drives),
            notes=(*train.skipped, *val.skipped, *test.skipped),
        )

    def _drive(self, images: PlaceImages, condition: str, split: str) -> Drive:
        rows = images.rows_of(condition)
        frames = images.frame[rows].astype(np.float64)
        name, settings = f"{split}/{condition}", self.settings
        return Drive.of(
            name,
            condition,
            np.column_stack([frames, np.zeros((len(rows), 2))]),
            motion=simulated_railway_motion(frames, settings.odometry_scale, settings.odometry_seed, name),
            images=images.images.select(rows),
            odometry="simulated",
        )


class PlaceFolderDrives:
    """The user's traverses, if their tables have positions and headings.

    The first traverse of the test is the map. Headings of tables are degrees counter-clockwise from x; those of UTM
    names are compass bearings, clockwise from north. Odometry is that of a simulated car.
    """

    def __init__(self, dataset: PlaceFolders, settings: DriveSettings | None = None):
        self.dataset, self.settings = dataset, settings or DriveSettings()
        self.name = dataset.name
        if dataset.place_unit != "m":
            raise ArgumentError(
                f"places={dataset.places} identifies places by their order only; "
                "task=localization needs x, y and heading of every image",
                "places=csv with tables file,x,y,heading, or dataset=pose_folder",
            )

    def conditions(self) -> tuple[str, ...]:
        """The names of the traverses, the map's first."""
        return self.dataset.conditions("test")

    def files(self, split: Split) -> list[Path]:
        """The images of a split; nothing is decoded."""
        if split == "validation":
            return self.dataset.files("val") if self.dataset.splits["val"] else []
        return self.dataset.files("test")

    def fingerprint(self) -> str:
        """Hash of the images, of their places and of the settings."""
        return self.settings.identity(self.dataset.fingerprint())

    def read(self) -> LocalizationData:
        """All drives, decoded the first time.

        Raises:
            UserError: files cannot be read, headings are missing, or there is only one traverse.
        """
        test = self.dataset.read("test")
        first, *drives = [self._drive(test, name, "test") for name in _several(self.conditions())]
        notes = test.skipped
        if self.dataset.splits["val"]:
            val = self.dataset.read("val")
            own, *validation = [self._drive(val, name, "val") for name in _several(self.dataset.conditions("val"))]
            early, late, validation_map = tuple(validation), tuple(drives), own
            notes += val.skipped
            return LocalizationData(first, late, early, validation_map, "m", "town", other_maps=late, notes=notes)
        if short := [drive.name for drive in drives if len(drive) < 2]:
            raise ArgumentError(f"test: {short[0]} has only one image, too few to localize", "Add images.")
        early, late = first_share(drives, self.settings.share(VALIDATION_SHARE))
        return LocalizationData(first, late, early, None, "m", "town", other_maps=tuple(drives), notes=notes)

    def _drive(self, images: PlaceImages, condition: str, split: str) -> Drive:
        rows = images.rows_of(condition)
        heading = self._headings(images, rows, condition)
        if images.position_m is None:  # the unit is metres: there are positions
            raise ValueError("positions are missing")
        poses = np.column_stack([images.position_m[rows], heading])
        name, settings = f"{split}/{condition}", self.settings
        return Drive.of(
            name,
            condition,
            poses,
            motion=simulated_motion(poses, CAR_WHEELS, settings.odometry_scale, settings.odometry_seed, name),
            images=images.images.select(rows),
            odometry="simulated",
        )

    def _headings(self, images: PlaceImages, rows: ndarray, condition: str) -> ndarray:
        degrees = np.full(len(rows), np.nan) if images.heading_deg is None else images.heading_deg[rows]
        if unknown := np.flatnonzero(np.isnan(degrees)).tolist():
            raise UserError(
                f"dataset={self.name}: {len(unknown):,} of {counted(len(rows), 'image')} of {condition} "
                f"{'has' if len(unknown) == 1 else 'have'} no heading, {images.names[rows[unknown[0]]]} for one",
                "Add a column heading to the tables (degrees counter-clockwise from x), "
                "or the field heading to the names.",
            )
        radians = np.radians(90.0 - degrees if self.dataset.places == "utm" else degrees)
        return np.asarray((radians + np.pi) % (2 * np.pi) - np.pi)


def _several(conditions: tuple[str, ...]) -> tuple[str, ...]:
    if len(conditions) < 2:
        raise ArgumentError(
            f"{list(conditions)}: the first condition is the map's, which leaves none to localize",
            "Give at least two, such as conditions=[summer,winter] or test='{reference: reference, query: query}'",
        )
    return conditions


def _joined(first: Drive, second: Drive) -> Drive:
    """Two stretches of one map as one; their images are copied into memory."""
    if first.images is None or second.images is None:
        raise ValueError("images are missing")
    images = ImageRows(np.concatenate([first.images[:], second.images[:]]))
    poses = np.concatenate([first.poses, second.poses])
    return Drive.of(f"{first.name}+{second.name}", first.condition, poses, images=images)
