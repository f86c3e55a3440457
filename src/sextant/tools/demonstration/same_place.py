"""Two photos: their similarity by the place-recognition network, beside that of known pairs."""

import json
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.applications.pixels import as_pixels
from sextant.baselines.place_descriptors import unit_norm
from sextant.chapters.places.describing import LARGEST_STRETCH
from sextant.chapters.places.place_map import PlaceMap
from sextant.errors import UserError
from sextant.tools.demonstration.pictures import page_picture

NETWORK = "zoo:places"
#: similarities of known pairs (``python -m benchmarks.same_place``): quantiles at :data:`SHARES`
KNOWN_PAIRS = Path(__file__).with_name("known_pairs.json")
SHARES = np.linspace(0, 1, 21)
#: standard deviation of pixels, of 255, below which a photo is blank; the plainest of the known pairs have 2.9
BLANK = 2


class SamePlace:
    """Compares pairs of photos.

    A similarity means little by itself, so it is reported beside those of pairs whose places are known.

    >>> found = SamePlace.load().answer(Path("day.jpg"), Path("night.jpg"))  # doctest: +SKIP
    >>> print(found["similarity"], found["known"])  # doctest: +SKIP

    Args:
        places: map whose descriptor compares; known pairs are those of the package's network.

    Attributes:
        size: height, width and channels of the images that are described.
    """

    def __init__(self, places: PlaceMap):
        self.places = places
        self.size = (places.size.height, places.size.width, places.size.channels)

    @classmethod
    def load(cls) -> Self:
        """Load the network of the package."""
        return cls(PlaceMap.load(NETWORK))

    def similarities(
        self, first: UInt8[ndarray, "n h w c"], second: UInt8[ndarray, "m h w c"]
    ) -> Float32[ndarray, "n m"]:
        """Cosine similarities of the descriptors of images."""
        describer = self.places.descriptor.describer
        assert describer is not None
        rows = [unit_norm(describer.describe(images)) for images in (first, second)]
        return np.asarray(rows[0] @ rows[1].T)

    def answer(self, first: Path, second: Path) -> dict[str, Any]:
        """How similar two photos are, and which shares of the known pairs are less or more similar.

        Raises:
            UserError: a photo cannot be read, or is blank.
        """
        shown = [page_picture(path) for path in (first, second)]  # checks files more strictly than the next line does
        images = [as_pixels(path, self.size) for path in (first, second)]
        for path, image in zip((first, second), images, strict=True):
            if image.std((0, 1)).max() < BLANK:
                raise UserError(f"{path} is blank", "Give a photo of a place.")
        similarity = float(self.similarities(images[0][None], images[1][None])[0, 0])
        wanted = self.size[1] / self.size[0]
        ratios = [each["width"] / each["height"] / wanted for each in shown]
        return {
            "photos": shown,
            "similarity": similarity,
            "known": known_pairs(similarity),
            "stretched": [max(ratio, 1 / ratio) > LARGEST_STRETCH for ratio in ratios],
        }


def known_pairs(similarity: float) -> dict[str, Any]:
    """The rank of a similarity among those of known pairs."""
    known = json.loads(KNOWN_PAIRS.read_text("utf-8"))
    same, other = (float(np.interp(similarity, known[kind], SHARES)) for kind in ("same", "other"))
    middle = {kind: [known[kind][2], known[kind][-3]] for kind in ("same", "other")}
    return {"sets": known["sets"], "same_below": same, "other_above": 1 - other, "middle_80": middle}
