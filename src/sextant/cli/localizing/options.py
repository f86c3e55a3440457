"""What a user may choose when images are localized; imports nothing heavy."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sextant.cli.arguments import one_of, whole
from sextant.errors import UserError

KEYS = {
    "odometry": "TUM trajectory, or table x,y,theta (m, rad) with a row an image; without it motion is unknown",
    "particles": "how many; as many as in the run's test unless given",
    "start": "where they begin: uniform over the map (default), or appearance: where the first image is found",
    "seed": "of all random numbers; 0 unless given",
    "every": "of a video, every so many frames; 1 unless given",
    "replay": "animation of the particles: mp4 (default), gif or none",
}
OUTPUT = "localization"


@dataclass(frozen=True)
class LocalizingOptions:
    """What the user chose; see :data:`KEYS`."""

    odometry: Path | None = None
    particles: int | None = None
    start: Literal["uniform", "appearance"] = "uniform"
    seed: int = 0
    every: int = 1
    replay: Literal["mp4", "gif", "none"] = "mp4"


def options_from(given: Mapping[str, str]) -> LocalizingOptions:
    """Read the keys of :data:`KEYS`.

    Raises:
        UserError: a value is not one of those allowed, or the odometry is no file.
    """
    odometry = Path(given["odometry"]).expanduser() if "odometry" in given else None
    if odometry is not None and not odometry.is_file():
        raise UserError(f"odometry={given['odometry']}: there is no such file", "Leave it out if there is none.")
    return LocalizingOptions(
        odometry,
        whole(given, "particles", 1),
        one_of(given, "start", ("uniform", "appearance")),
        whole(given, "seed", 0) or 0,
        whole(given, "every", 1) or 1,
        one_of(given, "replay", ("mp4", "gif", "none")),
    )
