"""The files of each photo: its camera, the undistorted photo, and the camera drawn into it."""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.applications.calibration.photo_camera import PhotoCamera
from sextant.applications.failures import FailedPhoto
from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_atomically, write_json
from sextant.data.photos import Keep, read_photo
from sextant.data.photos.file_stems import file_stems

if TYPE_CHECKING:
    from sextant.figures.calibration.overlay import CalibratedPhoto

SHEET = 40  # photos on the contact sheet
#: whether and how photos are undistorted
Undistort = Keep | Literal["none"]


def write_photos(
    found: Sequence[PhotoCamera | FailedPhoto], output: Path, undistort: Undistort
) -> tuple[list[dict[str, Any]], "list[CalibratedPhoto]"]:
    """Write ``<stem>.json``, ``<stem>_overlay.png`` and ``<stem>_undistorted`` for each photo that did not fail.

    Returns:
        The rows of all photos, and what belongs on the contact sheet.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    from sextant.figures.calibration.overlay import LONGEST_SIDE, calibration_overlay
    from sextant.figures.style import save_figure

    sheet: list[CalibratedPhoto] = []
    rows = [each.row() for each in found]
    good = [(each, row) for each, row in zip(found, rows, strict=True) if isinstance(each, PhotoCamera)]
    for (camera, row), stem in zip(good, file_stems([Path(camera.name) for camera, _ in good]), strict=True):
        image = read_photo(Path(camera.name)).image  # read again, so that only one photo at a time is in memory
        with telling_write_errors(output):
            _forget_straight(output, stem)
            if undistort != "none":
                row["undistorted"] = _write_straight(camera, image, output, stem, undistort)
            small = Image.fromarray(image)
            small.thumbnail((LONGEST_SIDE, LONGEST_SIDE), Image.Resampling.BOX)
            drawn = camera.drawn(np.asarray(small))
            save_figure(calibration_overlay(drawn), output, f"{stem}_overlay")
            write_json(output / f"{stem}.json", row)
        if len(sheet) < SHEET:
            sheet.append(drawn)
    return rows, sheet


def _forget_straight(output: Path, stem: str) -> None:
    """Remove the undistorted photo that an earlier run wrote, if the JSON file of that run names it."""
    try:
        earlier = json.loads((output / f"{stem}.json").read_text())["undistorted"]["file"]
    except (OSError, ValueError, KeyError, TypeError):
        return
    if earlier in (f"{stem}_undistorted.jpg", f"{stem}_undistorted.png"):
        (output / earlier).unlink(missing_ok=True)


def _write_straight(
    camera: PhotoCamera, image: UInt8[ndarray, "h w 3"], output: Path, stem: str, keep: Keep
) -> dict[str, Any]:
    kind = "jpg" if Path(camera.name).suffix.lower() in (".jpg", ".jpeg") else "png"
    name = f"{stem}_undistorted.{kind}"
    straight, focal = camera.undistort(image, keep)
    _save(Image.fromarray(straight), output / name, kind)
    return {"file": name, "focal_px": focal, "width": straight.shape[1], "height": straight.shape[0], "kept": keep}


def _save(image: Image.Image, path: Path, kind: str) -> None:
    buffer = io.BytesIO()
    options: dict[str, int] = {"quality": 95, "subsampling": 0} if kind == "jpg" else {"compress_level": 3}
    image.save(buffer, "JPEG" if kind == "jpg" else "PNG", **options)
    write_atomically(path, lambda file: file.write(buffer.getbuffer()))
