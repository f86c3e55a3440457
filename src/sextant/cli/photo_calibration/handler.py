"""The calibration of photos, as ``predict.py`` sees it."""

from collections.abc import Mapping
from pathlib import Path

from sextant.cli.photo_calibration.options import KEYS, options_from
from sextant.cli.predict_handler import Handler, Trained


class Calibration(Handler):
    """Says which camera took each photo."""

    task = "calibration"
    topic = "calibration"
    keys = KEYS

    def check(self, given: Mapping[str, str]) -> None:
        """Raise a ``UserError`` if a value of its keys has no meaning."""
        options_from(given)

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Calibrate photos."""
        from sextant.applications.calibration.model import TrainedModel
        from sextant.cli.photo_calibration.predict import predict_calibrations
        from sextant.recipes.trained_model import model_from_checkpoint
        from sextant.trained.content import own_config

        own = own_config(trained.about, trust=trained.trust)
        module = model_from_checkpoint(*own, trained.content, trained.found.checkpoint)
        predict_calibrations(TrainedModel(module), paths, output, options_from(given))
