"""The files of each photo: its camera, the photo made straight, and the camera drawn into it."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.applications.calibration.finding import Finding
from sextant.applications.calibration.model import CalibrationModel
from sextant.applications.calibration.options import CalibrationOptions
from sextant.applications.calibration.rows import camera_row
from sextant.atomic_files import write_atomically, write_json
from sextant.cli.output_folder import telling_write_errors
from sextant.cli.photo_calibration.drawing import calibrated_photo
from sextant.cli.photo_calibration.file_names import file_stems
from sextant.data.photos import Keep, read_photo, undistort_photo
from sextant.figures.calibration.overlay import LONGEST_SIDE, CalibratedPhoto, calibration_overlay
from sextant.figures.style import save_figure

SHEET = 40  # photos on the contact sheet


def write_photos(
    model: CalibrationModel,
    findings: Sequence[Finding],
    rows: dict[Path, dict[str, Any]],
    output: Path,
    options: CalibrationOptions,
) -> list[CalibratedPhoto]:
    """Write ``<stem>.json``, ``<stem>_overlay.png`` and ``<stem>_undistorted`` of each photo, and complete its row.

    Returns:
        What belongs on the contact sheet.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    sheet: list[CalibratedPhoto] = []
    for finding, stem in zip(findings, file_stems([finding.path for finding in findings]), strict=True):
        row = rows[finding.path]
        row |= camera_row(finding, model)
        image = read_photo(finding.path).image  # again, so that never more than one photo is in memory
        with telling_write_errors(output):
            if options.undistort != "none":
                row["undistorted"] = _write_straight(finding, image, row, output, stem, options.undistort)
            small = Image.fromarray(image)
            small.thumbnail((LONGEST_SIDE, LONGEST_SIDE), Image.Resampling.BOX)
            drawn = calibrated_photo(finding, np.asarray(small), row)
            save_figure(calibration_overlay(drawn), output, f"{stem}_overlay")
            write_json(output / f"{stem}.json", row)
        if len(sheet) < SHEET:
            sheet.append(drawn)
    return sheet


def _write_straight(
    finding: Finding, image: UInt8[ndarray, "h w 3"], row: dict[str, Any], output: Path, stem: str, keep: Keep
) -> dict[str, Any]:
    kind = "jpg" if finding.path.suffix.lower() in (".jpg", ".jpeg") else "png"
    name = f"{stem}_undistorted.{kind}"
    scale = image.shape[0] / finding.photo.height
    straight, focal = undistort_photo(image, finding.focal_px * scale, row["k1"], row["k2"], keep)
    _save(Image.fromarray(straight), output / name, kind)
    return {
        "file": name, "focal_px": focal, "width": straight.shape[1], "height": straight.shape[0], "kept": keep,
    }  # fmt: skip


def _save(image: Image.Image, path: Path, kind: str) -> None:
    buffer = io.BytesIO()
    options: dict[str, int] = {"quality": 95, "subsampling": 0} if kind == "jpg" else {"compress_level": 3}
    image.save(buffer, "JPEG" if kind == "jpg" else "PNG", **options)
    write_atomically(path, lambda file: file.write(buffer.getbuffer()))
