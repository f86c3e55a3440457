"""The base class of faults, and what they share."""

from dataclasses import dataclass

import numpy as np

from sextant.data.localization.drive import Drive
from sextant.data.localization.localization_data import LocalizationData
from sextant.errors import UserError


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
        UserError: the drive has no such frame, or it is the first, before which nothing has happened.
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
            f"{name}.length={length} from frame {first} on: {drive.name} has {len(drive)} frames",
            f"{name}.length={max(1, len(drive) - first)} at most",
        )
    return slice(first, first + length)
