"""Calibrates photos and writes their cameras to files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sextant.applications.calibration.calibrator import PhotoCalibrator
from sextant.applications.calibration.written_cameras import write_cameras
from sextant.cli.output_folder import make_output
from sextant.cli.photo_calibration.options import CalibrationOptions
from sextant.cli.photo_calibration.telling import tell
from sextant.cli.skipped_files import skipped_of
from sextant.cli.work_progress import counted


def predict_calibrations(
    calibrator: PhotoCalibrator, paths: Sequence[Path], output: Path, options: CalibrationOptions
) -> list[dict[str, Any]]:
    """Calibrate photos, write the results into ``output`` and show them; failed photos are named and skipped.

    Raises:
        UserError: no photo could be calibrated, the photos cannot be of one camera, or the disk is full.
    """
    make_output(output)
    photos = counted("calibrating", "photos", paths)
    written = write_cameras(calibrator, photos, output, **options.model_dump(exclude={"method"}))
    tell(written, skipped_of(written.rows, f"none of {len(paths):,} photos could be calibrated"))
    return written.rows
