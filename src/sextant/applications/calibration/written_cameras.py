"""Calibrating photos and writing the files of their cameras."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sextant.applications.calibration.calibrator import PhotoCalibrator
from sextant.applications.calibration.collected_files import write_collected
from sextant.applications.calibration.colmap_database import check_colmap, write_colmap
from sextant.applications.calibration.photo_camera import PhotoCamera
from sextant.applications.calibration.photo_files import Undistort, write_photos
from sextant.applications.calibration.priors import FocalPrior, GravityPrior
from sextant.applications.failures import FailedPhoto, FailedPhotosError


@dataclass(frozen=True)
class WrittenCameras:
    """What was found and written.

    Attributes:
        rows: plain values of each photo, including those that failed.
        summary: summary of the one camera, if they are of one.
        files: files for all photos together.
    """

    rows: list[dict[str, Any]]
    summary: dict[str, Any] | None
    files: list[Path]


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
) -> WrittenCameras:
    """Calibrate photos and write all results to a folder; a photo that fails is among the rows, and the rest go on.

    Args:
        calibrator: calibrates the photos.
        paths: files of the photos.
        output: an existing folder.
        undistort: whether and how photos are undistorted.
        camera: ``one`` fuses all photos as those of one camera.
        focal_prior, gravity_prior: as for :meth:`~sextant.PhotoCalibrator.calibrate`.
        colmap: write ``colmap/database.db`` and ``colmap/priors.json`` too.

    Raises:
        UserError: the photos cannot be of one camera, the folder already has a COLMAP database, or the disk is full.
    """
    if colmap:
        check_colmap(output / "colmap")
    found, summary = _calibrated(
        calibrator, paths, camera, {"focal_prior": focal_prior, "gravity_prior": gravity_prior}
    )
    rows, sheet = write_photos(found, output, undistort)
    write_collected(rows, summary, sheet, output)
    files = [output / f"calibrations.{kind}" for kind in ("csv", "json", "png")]
    good = [each for each in found if isinstance(each, PhotoCamera)]
    if colmap and good:
        files += write_colmap(good, output / "colmap")
    return WrittenCameras(rows, summary, files)


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
