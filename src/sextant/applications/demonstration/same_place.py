"""Two photos: how alike what describes places finds them, and what can be said of that."""

from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant import zoo
from sextant.applications.demonstration.pictures import page_picture
from sextant.applications.pixels import as_pixels
from sextant.applications.places.describing import LARGEST_STRETCH
from sextant.applications.places.place_map import PlaceMap
from sextant.atomic_files import read_json
from sextant.baselines.descriptor import unit_norm
from sextant.errors import UserError

#: the network that is taken once the zoo has it, and what describes places without training until then
NETWORK, UNTRAINED = "places", "Hog"
#: how alike known pairs are, by descriptor (``python -m benchmarks.same_place``): quantiles at :data:`SHARES`
ALIKE = Path(__file__).with_name("alike.json")
SHARES = np.linspace(0, 1, 21)
#: standard deviation of pixels, of 255, below which a photo is blank; the plainest of known pairs have 2.9
BLANK = 2


class SamePlace:
    """Compares photos two by two.

    A similarity means little by itself, for descriptors differ in how alike they find any two photos. So it stands
    beside those of pairs whose places are known.

    >>> found = SamePlace.load().answer(Path("day.jpg"), Path("night.jpg"))  # doctest: +SKIP
    >>> print(found["similarity"], found["known"])  # doctest: +SKIP

    Args:
        places: whose descriptor compares.
        name: of the descriptor.
        trained: whether it was.

    Attributes:
        size: height, width and channels of the images that are described.
    """

    def __init__(self, places: PlaceMap, name: str, *, trained: bool):
        self.places, self.name, self.trained = places, name, trained
        self.size = (places.size.height, places.size.width, places.size.channels)

    @classmethod
    def load(cls) -> Self:
        """By the zoo's network if there is one, else by what needs no training."""
        if NETWORK in zoo.names():
            return cls(PlaceMap.load(f"{zoo.PREFIX}{NETWORK}"), f"{zoo.PREFIX}{NETWORK}", trained=True)
        return cls(PlaceMap(UNTRAINED), "histograms of oriented gradients", trained=False)

    def alike(self, first: UInt8[ndarray, "n h w c"], second: UInt8[ndarray, "m h w c"]) -> Float32[ndarray, "n m"]:
        """Cosines of the descriptors of images."""
        describer = self.places.descriptor.describer
        assert describer is not None
        rows = [unit_norm(describer.describe(images)) for images in (first, second)]
        return np.asarray(rows[0] @ rows[1].T)

    def answer(self, first: Path, second: Path) -> dict[str, Any]:
        """How alike two photos are, and what shares of known pairs are less so, or more.

        Raises:
            UserError: a photo cannot be read, or is blank.
        """
        shown = [page_picture(path) for path in (first, second)]  # checks files more closely than the next line does
        images = [as_pixels(path, self.size) for path in (first, second)]
        for path, image in zip((first, second), images, strict=True):
            if image.std((0, 1)).max() < BLANK:
                raise UserError(f"{path} shows nothing to compare", "Give a photo that is not blank.")
        alike = float(self.alike(images[0][None], images[1][None])[0, 0])
        wanted = self.size[1] / self.size[0]
        ratios = [each["width"] / each["height"] / wanted for each in shown]
        return {
            "photos": shown,
            "similarity": alike,
            "descriptor": self.name,
            "trained": self.trained,
            "known": self._known(alike),
            "stretched": [max(ratio, 1 / ratio) > LARGEST_STRETCH for ratio in ratios],
        }

    def _known(self, alike: float) -> dict[str, Any] | None:
        """Where a similarity lies among those of known pairs; None where this descriptor was not measured."""
        known = (read_json(ALIKE) or {}).get(self.name)
        if known is None:
            return None
        same, other = (float(np.interp(alike, known[kind], SHARES)) for kind in ("same", "other"))
        middle = {kind: [known[kind][2], known[kind][-3]] for kind in ("same", "other")}
        return {"sets": known["sets"], "less_alike_of_one": same, "more_alike_of_two": 1 - other, "middle_80": middle}
