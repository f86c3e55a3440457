"""Trained filters for other programs: the feature map they use, and predictions for single photos."""

from pathlib import Path

from torch import nn

from sextant.errors import UserError
from sextant.kit.chapter import Content
from sextant.kit.offers import Exportable, Named, PhotoPredictor, Row, example_images, failed_row, image_meaning
from sextant.kit.trained import own_config
from sextant.runs.checkpoint import KEY


def exportable(content: Content, checkpoint: Path, *, trust: bool) -> Exportable:
    """The feature map that the filters use; the filters themselves are not a network."""
    from sextant.kit.trained import model_from_checkpoint

    spec = content[KEY]["spec"]
    estimator = model_from_checkpoint(own_config(content[KEY], trust=trust), content, checkpoint).estimator
    if estimator.features is None:
        raise UserError(
            f"the filters of {checkpoint} operate on images, not on a network",
            "Only networks are exported; filters are saved in their own format (docs/cosfire.md).",
        )
    shape = f"(b, {estimator.features.channels}, {', '.join(map(str, estimator.features.size))})"
    meanings = {
        "images": image_meaning(spec, spec["channels"]),
        "features": f"{shape}: the feature map that the filters use, after rectification",
    }
    return Exportable(Named(nn.Sequential(estimator.features, nn.ReLU())), {"images": example_images(spec)}, meanings)


def photo_predictor(content: Content, checkpoint: Path, *, trust: bool) -> PhotoPredictor:
    """The class of each photo."""
    from sextant.chapters.classification.classifier import class_numbers, decoded
    from sextant.kit.trained import image_spec, model_from_checkpoint

    estimator = model_from_checkpoint(own_config(content[KEY], trust=trust), content, checkpoint).estimator
    spec = image_spec(content[KEY]["spec"])

    def one(photo: Path) -> Row:
        try:
            image = decoded(photo, spec)
        except UserError as error:
            return failed_row(error)
        (scores,) = class_numbers([image], estimator.first_scores, str(checkpoint))
        return {"label": spec.classes[scores.index(max(scores))], "score": max(scores)}

    return PhotoPredictor({"label": "string", "score": "double"}, lambda photos: [one(photo) for photo in photos])
