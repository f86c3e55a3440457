"""The interface of localization datasets."""

from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from sextant.chapters.localization.data.drive import LocalizationData
from sextant.chapters.localization.data.simulated import DriveSettings, Split
from sextant.errors import UserError


@runtime_checkable
class LocalizationSource(Protocol):
    """A dataset with a map and drives to localize in it.

    Attributes:
        name: name of the dataset in messages.
    """

    name: str

    def conditions(self) -> tuple[str, ...]:
        """The conditions of all drives, the map's first; nothing is read."""

    def files(self, split: Split) -> list[Path]:
        """The files that a split is read from; nothing is rendered or decoded.

        Raises:
            UserError: the files are missing.
        """

    def fingerprint(self) -> str:
        """Hash that changes when the data does."""

    def read(self) -> LocalizationData:
        """All drives.

        Raises:
            UserError: a file cannot be read; the message names it.
        """


def as_localization_source(dataset: Any, settings: DriveSettings | None = None) -> LocalizationSource:
    """A dataset as a source of drives with poses.

    Args:
        dataset: a dataset as built from a config.
        settings: how drives are made from it; None for the defaults.

    Raises:
        UserError: the dataset has no drives, or none with known poses.
    """
    settings = settings or DriveSettings()
    # a rendered world: its modules are loaded anyway
    source = _rendered(dataset, settings) if hasattr(dataset, "plan") else _of_files(dataset, settings)
    if source is None:
        name = getattr(dataset, "name", type(dataset).__name__)
        raise UserError(
            f"dataset={name} has no drives with poses, which task=localization needs",
            "Choose office_walk, cold, town_seasons or town_city (rendered here), nordland, or your own: "
            "pose_folder, place_folders.",
        )
    return source


def _rendered(dataset: Any, settings: DriveSettings) -> LocalizationSource | None:
    from sextant.chapters.localization.data.office_drives import OfficeDrives
    from sextant.chapters.localization.data.town_drives import TownCityDrives, TownSeasonsDrives
    from sextant.data.worlds import OfficeWalk, TownCity, TownFactors, TownSeasons

    if isinstance(dataset, OfficeWalk):
        return OfficeDrives(dataset, settings)
    if isinstance(dataset, TownCity):
        return TownCityDrives(dataset, settings)
    if isinstance(dataset, TownSeasons) and not isinstance(dataset, TownFactors):  # whose factors have no validation
        return TownSeasonsDrives(dataset, settings)
    return None


def _of_files(dataset: Any, settings: DriveSettings) -> LocalizationSource | None:
    from sextant.chapters.localization.data.place_drives import PlaceFolderDrives, RailwayDrives
    from sextant.chapters.localization.data.pose_folder import PoseFolder
    from sextant.chapters.places.data import Nordland, PlaceFolders

    if isinstance(dataset, PoseFolder):
        return dataset.with_settings(settings)
    if isinstance(dataset, Nordland):
        return RailwayDrives(dataset, settings)
    if isinstance(dataset, PlaceFolders):
        return PlaceFolderDrives(dataset, settings)
    return dataset if isinstance(dataset, LocalizationSource) else None
