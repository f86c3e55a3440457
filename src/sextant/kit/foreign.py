"""Classifiers of others, in the form of a checkpoint."""

from typing import Any

from sextant.config import Config
from sextant.config.building import build
from sextant.data.source import ImageSource
from sextant.errors import UserError
from sextant.models.foreign_classifier import ForeignClassifier
from sextant.models.weights_file import fit_weights
from sextant.runs.checkpoint import KEY, SCHEMA_VERSION


def require_foreign_fit(foreign: ForeignClassifier, source: ImageSource) -> None:
    """Raise a ``UserError`` unless the images have three channels and as many classes as the classifier."""
    spec = source.spec()
    if spec.channels != 3:
        raise UserError(
            f"dataset={source.name} has images of {spec.channels} channel, model={foreign.reference} takes 3",
            "Choose a dataset of colour images, or dataset.channels=3 for dataset=image_folder.",
        )
    if len(spec.classes) != foreign.classes:
        raise UserError(
            f"dataset={source.name} has {len(spec.classes)} classes, model={foreign.reference} has {foreign.classes}",
            "Choose the dataset that it was trained on. Classes are compared by their order.",
        )


def foreign_content(foreign: ForeignClassifier, config: Config, source: ImageSource) -> dict[str, Any]:
    """A classifier with its weights and the inhibition of ``config``, in the form of a checkpoint.

    Raises:
        UserError: the network cannot be built for these images, the weights do not fit it, or the inhibition does not.
    """
    spec = source.spec()
    size = (spec.height, spec.width)
    network = build(config.plain, "backbone", in_channels=spec.channels, image_size=size, num_classes=len(spec.classes))
    fit_weights(network, foreign.state, f"model={foreign.reference}")
    try:
        network = build(config.plain, "inhibition")(network)
    except ValueError as error:
        raise UserError(f"inhibition: {error}", "Choose another inhibition, or inhibition=none") from None
    return {
        KEY: {
            "schema_version": SCHEMA_VERSION,
            "config": dict(config.plain),
            "spec": {"channels": 3, "height": spec.height, "width": spec.width, "classes": list(spec.classes)},
            "task": config.task.name,
            "foreign": {"card": foreign.card(), "sha256": foreign.identity},
        },
        "state_dict": {f"network.{name}": tensor for name, tensor in network.state_dict().items()},
    }
