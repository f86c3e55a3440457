"""Trained classifiers for other programs: as a network on tensors, and as predictions for single photos."""

from collections.abc import Sequence
from pathlib import Path

from sextant.kit.chapter import Content
from sextant.kit.offers import Exportable, Named, PhotoPredictor, Row, example_images, failed_row, image_meaning
from sextant.kit.trained import own_config
from sextant.runs.checkpoint import KEY


def exportable(content: Content, checkpoint: Path, *, trust: bool) -> Exportable:
    """Maps images to logits."""
    from sextant.kit.trained import trained_network

    spec = content[KEY]["spec"]
    network = trained_network(own_config(content[KEY], trust=trust), content, checkpoint)
    meanings = {
        "images": image_meaning(spec, spec["channels"]),
        "logits": f"(b, {len(spec['classes'])}), in this order: {', '.join(map(str, spec['classes']))}",
    }
    return Exportable(Named(network), {"images": example_images(spec)}, meanings)


def photo_predictor(content: Content, checkpoint: Path, *, trust: bool) -> PhotoPredictor:
    """The class of each photo."""
    from sextant.applications import FailedPhoto, ImageClassifier

    classifier = ImageClassifier.of(content, checkpoint, trust=trust)

    def answer(photos: Sequence[Path]) -> list[Row]:
        found = classifier.classify_many(photos, errors="return")
        return [
            failed_row(each.error)
            if isinstance(each, FailedPhoto)
            else {"label": each.label, "score": each.probability}
            for each in found
        ]

    return PhotoPredictor({"label": "string", "score": "double"}, answer)
