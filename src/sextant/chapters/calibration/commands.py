"""Calibration of photos, and of the frames of a video, in ``predict.py``. Imports nothing heavy."""

from collections.abc import Mapping
from pathlib import Path

from sextant.applications.arguments import check_apart
from sextant.chapters.calibration.options import CalibrationOptions
from sextant.console.written import make_output
from sextant.data.photo_files import find_photos
from sextant.data.videos import is_video
from sextant.errors import UserError
from sextant.kit.handler import Handler, Trained


class Calibration(Handler):
    """Estimates the camera of each photo."""

    task = "calibration"
    topic = "calibration"
    usage = "sextant predict network=geocalib:<file> input=<image, folder, pattern or video> [output=calibrated]"
    keys = CalibrationOptions.meanings()
    needs = ("input",)
    shared = ("input", "output")
    named_by = "network="

    def claims(self, given: Mapping[str, str]) -> bool:
        """Whether a network of others is named."""
        return "network" in given

    def check(self, given: Mapping[str, str]) -> None:
        """Raise a ``UserError`` if a value of its keys is invalid."""
        options = CalibrationOptions.of(given)
        if options.scale is not None and options.network is None:
            raise UserError(f"scale={options.scale} is for a network of others", self.usage)

    def predict(self, given: Mapping[str, str]) -> None:
        """Calibrate photos by a network of others."""
        self.check(given)
        output = Path(given.get("output", "calibrated")).expanduser()
        paths = find_photos(given["input"], output)
        check_apart(output, paths, input=given["input"])
        make_output(output)
        from sextant.chapters.calibration.predict import calibrator_of_others, predict_calibrations

        paths, options = _of_clip(given, paths, output)
        predict_calibrations(calibrator_of_others(options, options.method), paths, output, options)

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Calibrate photos."""
        from sextant.applications import PhotoCalibrator
        from sextant.chapters.calibration.predict import predict_calibrations

        content = trained.content
        paths, options = _of_clip(given, paths, output)
        calibrator = PhotoCalibrator.of(content, trained.found.checkpoint, trust=trained.trust, method=options.method)
        predict_calibrations(calibrator, paths, output, options)


def _of_clip(given: Mapping[str, str], paths: list[Path], output: Path) -> tuple[list[Path], CalibrationOptions]:
    """The photos and the options; for a video, its frames, which are of one camera unless ``camera=each``."""
    options = CalibrationOptions.of(given)
    if not is_video(Path(given["input"]).expanduser()):
        if options.every is not None:
            raise UserError(f"every={options.every} applies to a video; input={given['input']} is not one")
        return paths, options
    from sextant.chapters.calibration.predict import video_frames

    camera = options.camera if "camera" in given else "one"
    return video_frames(paths[0], output, options.every), options.model_copy(update={"camera": camera})


HANDLERS = (Calibration,)
