"""Localization in one world by a model that was fitted in another."""

import hashlib
from dataclasses import replace
from pathlib import Path

from sextant.chapters.localization.data.drive import Drive, LocalizationData
from sextant.chapters.localization.data.simulated import Split
from sextant.chapters.localization.data.source import LocalizationSource


class FittedElsewhere:
    """The map and the test drives of one world, with the validation drives of another and the map they are in.

    Whatever is fitted - descriptor, kernel, noise, tempering, the width of regions - is fitted to the other world. The
    tested world provides only its map, on which the filter conditions, and the test drives.

    Args:
        tested, fitted: the two worlds, of one kind of dataset.
        number: of the other world, for the names of its drives.
    """

    def __init__(self, tested: LocalizationSource, fitted: LocalizationSource, number: int):
        self.tested, self.fitted, self.number, self.name = tested, fitted, number, tested.name

    def conditions(self) -> tuple[str, ...]:
        """The conditions of the drives, the map's first; nothing is read."""
        return self.tested.conditions()

    def files(self, split: Split) -> list[Path]:
        """The files that a split is read from; nothing is rendered or decoded."""
        return (self.fitted if split == "validation" else self.tested).files(split)

    def fingerprint(self) -> str:
        """Hash of both worlds."""
        return hashlib.sha256("\0".join([self.tested.fingerprint(), self.fitted.fingerprint()]).encode()).hexdigest()

    def read(self) -> LocalizationData:
        """All drives; those of the other world are named after it.

        Raises:
            UserError: as for either world.
        """
        tested, fitted = self.tested.read(), self.fitted.read()

        def named(drive: Drive) -> Drive:
            return replace(drive, name=f"world{self.number}/{drive.name}")

        learnt = named(fitted.map)
        return replace(
            tested,
            validation=tuple(map(named, fitted.validation)),
            validation_map=learnt if fitted.validation_map is None else named(fitted.validation_map),
            fit_map=learnt,
        )
