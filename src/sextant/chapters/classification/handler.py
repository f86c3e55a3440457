"""The ``predict.py`` handler for classification of images."""

from collections.abc import Mapping
from pathlib import Path

from sextant.kit.handler import Handler, Trained


class Classification(Handler):
    """Predicts the class of each image."""

    task = "classification"

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Classify images."""
        from sextant.chapters.classification.predict import predict_classes

        predict_classes(trained, paths, output, given["input"])
