"""Output files of calibrated photos: undistorted photos, tables, pictures, a COLMAP database."""

import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.applications.failures import FailedPhoto, FailedPhotosError, attempted
from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_atomically, write_csv, write_json
from sextant.chapters.calibration.calibrator import PhotoCalibrator
from sextant.chapters.calibration.colmap_database import check_colmap, write_colmap
from sextant.chapters.calibration.exports import check_exports, photo_stems, write_exports
from sextant.chapters.calibration.finding import LEVELS
from sextant.chapters.calibration.options import Export, Undistort
from sextant.chapters.calibration.photo_camera import PhotoCamera
from sextant.chapters.calibration.priors import FocalPrior, GravityPrior
from sextant.data.photos import Keep, read_photo
from sextant.tables import counted

if TYPE_CHECKING:
    from sextant.chapters.calibration.figures.overlay import CalibratedPhoto


COLUMNS = (
    "file", "verdict", "tilt_deg", "roll_deg", "focal_px", "vfov_deg", "true_vfov_deg", "true_hfov_deg", "k1", "k2",
    "width", "height", "exif_focal_px", "error",
)  # fmt: skip
BOUNDED = [(name, level) for name in ("tilt_deg", "roll_deg", "focal_px", "vfov_deg", "k1") for level in LEVELS]


def write_collected(
    rows: Sequence[Mapping[str, Any]],
    summary: Mapping[str, Any] | None,
    sheet: "Sequence[CalibratedPhoto]",
    output: Path,
) -> None:
    """Write ``calibrations.json``, ``calibrations.csv`` and ``calibrations.png``.

    Args:
        rows: rows of all photos, including those that failed.
        summary: summary of the one camera, if they are of one.
        sheet: photos on the contact sheet.
        output: folder to write into.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    with telling_write_errors(output):
        write_json(output / "calibrations.json", {"photos": list(rows), "camera": summary})
        names = [f"{q}_{level}_{end}" for q, level in BOUNDED for end in ("low", "high")]
        write_csv(output / "calibrations.csv", [*COLUMNS, *names], map(_flat, rows))
        if sheet:
            from sextant.chapters.calibration.figures.overlay import photo_sheet
            from sextant.figures.style import save_figure

            save_figure(photo_sheet(sheet), output, "calibrations")


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    flat = dict(row)
    if "intervals" in row:
        flat["verdict"] = row["confidence"]["verdict"]
        for quantity, level in BOUNDED:
            for end, value in zip(("low", "high"), row["intervals"][level][quantity], strict=True):
                flat[f"{quantity}_{level}_{end}"] = value if math.isfinite(value) else ""
    return flat


SHEET = 40  # photos on the contact sheet


def write_photos(
    found: Sequence[PhotoCamera | FailedPhoto], output: Path, undistort: Undistort
) -> tuple[list[PhotoCamera], list[dict[str, Any]], "list[CalibratedPhoto]"]:
    """Write ``<stem>.json``, ``<stem>_overlay.png`` and ``<stem>_undistorted`` for each photo that did not fail.

    A photo that can no longer be read has failed too.

    Returns:
        The cameras of the photos written, the rows of all, and what belongs on the contact sheet.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    from sextant.chapters.calibration.figures.overlay import LONGEST_SIDE, calibration_overlay
    from sextant.figures.style import save_figure

    good: list[PhotoCamera] = []
    sheet: list[CalibratedPhoto] = []
    rows = [each.row() for each in found]
    stems = iter(photo_stems([each for each in found if isinstance(each, PhotoCamera)]))
    for i, camera in enumerate(found):
        if isinstance(camera, FailedPhoto):
            continue
        row, stem = rows[i], next(stems)
        photo = attempted(camera.name, read_photo, Path(camera.name))  # again: only one at a time is in memory
        if isinstance(photo, FailedPhoto):
            rows[i] = photo.row()
            continue
        with telling_write_errors(output):
            _forget_straight(output, stem)
            if undistort != "none":
                row["undistorted"] = _write_straight(camera, photo.image, output, stem, undistort)
            small = Image.fromarray(photo.image)
            small.thumbnail((LONGEST_SIDE, LONGEST_SIDE), Image.Resampling.BOX)
            drawn = camera.drawn(np.asarray(small))
            save_figure(calibration_overlay(drawn), output, f"{stem}_overlay")
            write_json(output / f"{stem}.json", row)
        good.append(camera)
        if len(sheet) < SHEET:
            sheet.append(drawn)
    return good, rows, sheet


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
    save_picture(straight, output / name)
    return {"file": name, "focal_px": focal, "width": straight.shape[1], "height": straight.shape[0], "kept": keep}


def save_picture(image: UInt8[ndarray, "h w 3"], path: Path) -> None:
    """Write a picture as JPEG or PNG, by the suffix of its file."""
    jpeg, buffer = path.suffix == ".jpg", io.BytesIO()
    options: dict[str, int] = {"quality": 95, "subsampling": 0} if jpeg else {"compress_level": 3}
    Image.fromarray(image).save(buffer, "JPEG" if jpeg else "PNG", **options)
    write_atomically(path, lambda file: file.write(buffer.getbuffer()))


@dataclass(frozen=True)
class WrittenCameras:
    """Results of calibrated photos and the files written.

    Attributes:
        rows: plain values of each photo, including those that failed.
        summary: summary of the one camera, if they are of one.
        files: files for all photos together.
        earlier: results of an earlier run that the folder still holds, for a message.
    """

    rows: list[dict[str, Any]]
    summary: dict[str, Any] | None
    files: list[Path]
    earlier: Sequence[str] = ()


def write_cameras(
    calibrator: PhotoCalibrator,
    paths: Iterable[Path],
    output: Path,
    *,
    undistort: Undistort = "crop",
    camera: Literal["each", "one"] = "each",
    focal_prior: FocalPrior = None,
    gravity_prior: GravityPrior = None,
    colmap: bool = False,
    exports: Sequence[Export] = (),
) -> WrittenCameras:
    """Calibrate photos and write all results to a folder; a photo that fails gets a row with its error.

    Args:
        calibrator: calibrates the photos.
        paths: files of the photos.
        output: an existing folder.
        undistort: whether and how photos are undistorted.
        camera: ``one`` fuses all photos as those of one camera.
        focal_prior, gravity_prior: as for :meth:`~sextant.PhotoCalibrator.calibrate`.
        colmap: write ``colmap/database.db`` and ``colmap/priors.json`` too.
        exports: formats of other programs, see :func:`~.exports.write_exports`.

    Raises:
        UserError: the photos cannot be of one camera, the folder already has a COLMAP database, a camera cannot be
            expressed in a format, or the disk is full.
    """
    check_exports(exports, undistort)
    if colmap:
        check_colmap(output / "colmap")
    before = _photos_of(output)
    found, summary = _calibrated(
        calibrator, paths, camera, {"focal_prior": focal_prior, "gravity_prior": gravity_prior}
    )
    good, rows, sheet = write_photos(found, output, undistort)
    write_collected(rows, summary, sheet, output)
    files = [output / f"calibrations.{kind}" for kind in ("csv", "json", "png")]
    if colmap and good:
        files += write_colmap(good, output / "colmap")
    if exports and good:
        copies = [output / row["undistorted"]["file"] for row in rows if "undistorted" in row]
        files += write_exports(good, copies, output, exports, "all" if undistort == "all" else "crop")
    now = {Path(row["file"]).name for row in rows}
    earlier = [f"{counted(len(left), 'photo')}, such as {left[0]}"] if (left := sorted(before - now)) else []
    earlier += [name for name in ("transforms.json", "colmap") if (output / name).exists() and not _has(files, name)]
    return WrittenCameras(rows, summary, files, earlier)


def _photos_of(output: Path) -> set[str]:
    """Names of the photos that an earlier run calibrated into a folder."""
    try:
        rows = json.loads((output / "calibrations.json").read_text("utf-8"))["photos"]
        return {Path(row["file"]).name for row in rows if "error" not in row}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def _has(files: Sequence[Path], name: str) -> bool:
    return any(name in (path.name, path.parent.name) for path in files)


def _calibrated(
    calibrator: PhotoCalibrator, paths: Iterable[Path], camera: Literal["each", "one"], priors: dict[str, Any]
) -> tuple[Sequence[PhotoCamera | FailedPhoto], dict[str, Any] | None]:
    """The result for each photo, and the summary of the one camera, if they are of one."""
    if camera == "each":
        return calibrator.calibrate_many(paths, **priors, errors="return"), None
    try:
        one = calibrator.one_camera(paths, **priors, errors="return")
    except FailedPhotosError as error:
        return error.failed, None
    return one.photos, one.row()
