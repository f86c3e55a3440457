"""Trained place descriptors for other programs: as an exported network, and as predictions for single photos."""

from collections.abc import Sequence
from pathlib import Path

from sextant.kit.chapter import Content
from sextant.kit.offers import ERROR, Exportable, Named, PhotoPredictor, Row, example_images, image_meaning
from sextant.kit.trained import own_config
from sextant.runs.checkpoint import KEY


def exportable(content: Content, checkpoint: Path, *, trust: bool) -> Exportable:
    """Images to descriptors."""
    from sextant.kit.trained import trained_network

    spec = content[KEY]["spec"]
    network = trained_network(own_config(content[KEY], trust=trust), content, checkpoint)
    meanings = {
        "images": f"{image_meaning(spec, spec['channels'])}, the whole photo stretched to this size",
        "descriptor": f"(b, {network.dimension}): photos of one place have similar descriptors",
    }
    return Exportable(Named(network), {"images": example_images(spec)}, meanings)


def photo_predictor(content: Content, checkpoint: Path, *, trust: bool) -> PhotoPredictor:
    """The descriptor of each photo."""
    from sextant.chapters.places.describing import describe
    from sextant.chapters.places.network import trained_place_network

    network = trained_place_network(content, checkpoint, str(checkpoint), trust=trust)

    def answer(photos: Sequence[Path]) -> list[Row]:
        found = describe(network, network.size, photos)
        rows = iter(found.rows.tolist())
        return [
            {ERROR: found.failed[number]} if number in found.failed else {"descriptor": next(rows)}
            for number in range(len(photos))
        ]

    return PhotoPredictor({"descriptor": "doubles"}, answer)
