"""Calibration of photos in ``predict.py``. Imports nothing heavy."""

from collections.abc import Mapping
from pathlib import Path

from sextant.chapters.calibration.options import CalibrationOptions
from sextant.kit.handler import Handler, Trained


class Calibration(Handler):
    """Estimates the camera of each photo."""

    task = "calibration"
    topic = "calibration"
    keys = CalibrationOptions.meanings()

    def check(self, given: Mapping[str, str]) -> None:
        """Raise a ``UserError`` if a value of its keys is invalid."""
        CalibrationOptions.of(given)

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Calibrate photos."""
        from sextant.applications import PhotoCalibrator
        from sextant.chapters.calibration.predict import predict_calibrations

        options, content = CalibrationOptions.of(given), trained.content
        calibrator = PhotoCalibrator.of(content, trained.found.checkpoint, trust=trained.trust, method=options.method)
        predict_calibrations(calibrator, paths, output, options)


HANDLERS = (Calibration,)
