"""Classification of images, as ``predict.py`` sees it."""

from collections.abc import Mapping
from pathlib import Path

from sextant.cli.predict_handler import Handler, Trained


class Classification(Handler):
    """Says what each image shows."""

    task = "classification"

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Classify images."""
        from sextant.cli.image_classification.predict import predict_classes

        predict_classes(trained, paths, output, given["input"])
