"""What a user may choose when images are localized, and the map that ``run=`` names; imports nothing heavy."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sextant.atomic_files import read_json
from sextant.errors import UserError
from sextant.runs.resolve import resolve_run

KEYS = {
    "odometry": "TUM trajectory, or table x,y,theta (m, rad) with a row an image; without it motion is unknown",
    "particles": "how many; as many as in the run's test unless given",
    "start": "where they begin: uniform over the map (default), or appearance: where the first image is found",
    "seed": "of all random numbers; 0 unless given",
    "every": "of a video, every so many frames; 1 unless given",
    "replay": "animation of the particles: mp4 (default), gif or none",
}
MAP, HEADER, FORMAT = "map", "map.json", "sextant.localization_map"
OUTPUT = "localization"
CHOICES = {"start": ("uniform", "appearance"), "replay": ("mp4", "gif", "none")}


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
    for key, allowed in CHOICES.items():
        if given.get(key, allowed[0]) not in allowed:
            raise UserError(
                f"{key}={given[key]} must be one of {', '.join(allowed)}", f"For example {key}={allowed[1]}"
            )
    odometry = Path(given["odometry"]).expanduser() if "odometry" in given else None
    if odometry is not None and not odometry.is_file():
        raise UserError(f"odometry={given['odometry']}: there is no such file", "Leave it out if there is none.")
    return LocalizingOptions(
        odometry,
        _whole(given, "particles", 1, None),
        given.get("start", "uniform"),  # type: ignore[arg-type]  # checked above
        _whole(given, "seed", 0, 0) or 0,
        _whole(given, "every", 1, 1) or 1,
        given.get("replay", "mp4"),  # type: ignore[arg-type]
    )


def localization_map(reference: str, outputs: Path) -> Path | None:
    """The folder of the map that ``run=`` names, or None if it names no run of localization.

    Raises:
        UserError: the run kept no map.
    """
    path = Path(reference).expanduser()
    for folder in (path, path / MAP):
        header = read_json(folder / HEADER)
        if isinstance(header, dict) and header.get("format") == FORMAT:
            return folder
    try:
        found = resolve_run(reference, outputs)
    except UserError:
        return None  # told where a run is needed
    if found.directory is None or found.directory.state().get("task") != "localization":
        return None
    folder = found.directory.path / MAP
    if folder.is_dir():
        return folder
    raise UserError(
        f"run={reference}: the run kept no map in {folder}",
        f"python evaluate.py run={reference} task.save_map=true writes one; then run=<the folder of that test>. "
        "A laser's run has no map of images.",
    )


def _whole(given: Mapping[str, str], key: str, least: int, default: int | None) -> int | None:
    if key not in given:
        return default
    if not (given[key].isascii() and given[key].isdigit() and int(given[key]) >= least):
        raise UserError(f"{key}={given[key]} must be a whole number from {least} up", f"For example {key}=10")
    return int(given[key])
