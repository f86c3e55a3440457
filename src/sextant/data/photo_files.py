"""Find the photos that a path, a folder or a pattern names; imports no torch."""

import glob
import logging
import os
from collections.abc import Iterable
from fnmatch import fnmatchcase
from pathlib import Path

from sextant.data.image_files import SUFFIXES
from sextant.errors import UserError

log = logging.getLogger(__name__)

#: the last two are not decoded: they are found so that messages can name them
FOUND_IN_FOLDERS = (*SUFFIXES, ".gif", ".jp2", ".heic", ".heif")
#: names of pictures that predictions write: :mod:`~sextant.applications.calibration.photo_files`,
#: :mod:`~sextant.cli.place_matching.gallery_pages`
WRITTEN = ("*_overlay.png", "*_undistorted.png", "*_undistorted.jpg", "*calibrations.png", "matches_page*.png")


def find_photos(given: str, output: Path | None, key: str = "input") -> list[Path]:
    """The photo at a path, all photos below a folder, or those matching a pattern, in order; never files written here.

    Args:
        given: path, folder or pattern.
        output: folder that predictions are written to, if there is one.
        key: of the argument, for messages.

    Raises:
        UserError: there is no photo.
    """
    path = Path(given).expanduser()
    if path.is_file():
        return [path]
    if path.is_dir():
        candidates: Iterable[Path] = list(path.rglob("*"))
        shut = [str(p) for p in (path, *candidates) if os.path.isdir(p) and not os.access(p, os.R_OK | os.X_OK)]
        if shut:
            log.warning("%s=%s: left out, as it cannot be read: %s", key, given, ", ".join(shut))
    else:
        candidates = (Path(name) for name in glob.glob(str(path), recursive=True))
    written = None if output is None else output.resolve()
    found = sorted(
        p
        for p in candidates
        if p.suffix.lower() in FOUND_IN_FOLDERS
        and (os.path.isfile(p) or (os.path.islink(p) and not os.path.exists(p)))  # the reader reports broken links
        and not (written and any(fnmatchcase(p.name, name) for name in WRITTEN) and p.resolve().is_relative_to(written))
    )
    if not found:
        raise UserError(
            f"{key}={given}: no photo there",
            "Give a photo, a folder or a pattern such as 'photos/*.jpg'. "
            f"Photos end in {', '.join(FOUND_IN_FOLDERS[:-2])}",
        )
    return found
