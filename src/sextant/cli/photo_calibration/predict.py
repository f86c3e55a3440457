"""From photos to files of their cameras."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sextant.applications.calibration.calibrator import PhotoCalibrator
from sextant.applications.calibration.collected_files import write_collected
from sextant.applications.calibration.photo_camera import PhotoCamera
from sextant.applications.calibration.photo_files import write_photos
from sextant.applications.failures import FailedPhoto, FailedPhotosError
from sextant.cli.output_folder import make_output
from sextant.cli.photo_calibration.options import CalibrationOptions
from sextant.cli.photo_calibration.telling import tell
from sextant.cli.skipped_files import skipped_of


def predict_calibrations(
    calibrator: PhotoCalibrator, paths: Sequence[Path], output: Path, options: CalibrationOptions
) -> list[dict[str, Any]]:
    """Calibrate photos, write everything into ``output`` and show it; a photo that fails is named and the rest go on.

    Raises:
        UserError: not one photo could be calibrated, they cannot be of one camera, or the disk is full.
    """
    make_output(output)
    found, summary = _calibrated(calibrator, paths, options)
    rows, sheet = write_photos(found, output, options.undistort)
    write_collected(rows, summary, sheet, output)
    tell(rows, skipped_of(rows, f"none of {len(rows):,} photos could be calibrated"), summary, output)
    return rows


def _calibrated(
    calibrator: PhotoCalibrator, paths: Sequence[Path], options: CalibrationOptions
) -> tuple[Sequence[PhotoCamera | FailedPhoto], dict[str, Any] | None]:
    """What was found of each photo, and the summary of the one camera, if they are of one."""
    if options.camera == "each":
        return calibrator.calibrate_many(paths, focal_prior=options.focal_prior, errors="return"), None
    try:
        one = calibrator.one_camera(paths, focal_prior=options.focal_prior, errors="return")
    except FailedPhotosError as error:
        return error.failed, None
    return one.photos, one.row()
