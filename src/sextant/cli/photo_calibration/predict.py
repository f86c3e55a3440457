"""From photos to files of their cameras."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sextant.applications.calibration.inference import find_cameras
from sextant.applications.calibration.model import CalibrationModel
from sextant.applications.calibration.one_camera import fuse_as_one_camera
from sextant.applications.calibration.options import CalibrationOptions
from sextant.applications.calibration.priors import use_prior
from sextant.cli.output_folder import make_output
from sextant.cli.photo_calibration.collected_files import write_collected
from sextant.cli.photo_calibration.photo_files import write_photos
from sextant.cli.photo_calibration.telling import tell
from sextant.cli.skipped_files import skipped_of


def predict_calibrations(
    model: CalibrationModel, paths: Sequence[Path], output: Path, options: CalibrationOptions
) -> list[dict[str, Any]]:
    """Calibrate photos, write everything into ``output`` and tell it; a photo that fails is named and the rest go on.

    Raises:
        UserError: not one photo could be calibrated, they cannot be of one camera, or the disk is full.
    """
    make_output(output)
    rows: dict[Path, dict[str, Any]] = {path: {"file": str(path)} for path in paths}
    findings = list(find_cameras(model, list(rows), rows))
    summary = fuse_as_one_camera(findings, options) if options.camera == "one" and findings else None
    if options.camera == "each":
        for finding in findings:
            use_prior(finding, options)
    sheet = write_photos(model, findings, rows, output, options)
    write_collected(list(rows.values()), summary, sheet, output)
    skipped = skipped_of(rows.values(), f"none of {len(rows):,} photos could be calibrated")
    tell(list(rows.values()), skipped, summary, output)
    return list(rows.values())
