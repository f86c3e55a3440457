"""Classification of images in ``predict.py``. Imports nothing heavy."""

from collections.abc import Mapping
from pathlib import Path

from sextant.kit.handler import Handler, Trained


class Classification(Handler):
    """Predicts the class of each image."""

    task = "classification"

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Classify images."""
        from sextant.chapters.classification.classifier import Answering, ImageClassifier
        from sextant.chapters.classification.predict import predict_classes

        def opened() -> tuple[str, Answering]:
            classifier = ImageClassifier.of(trained.content, trained.found.checkpoint, trust=trained.trust)
            return "probability", classifier.probabilities

        predict_classes(trained, opened, paths, output, given["input"])


HANDLERS = (Classification,)
