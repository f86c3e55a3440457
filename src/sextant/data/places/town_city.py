"""A rendered city as places: what a map of all directions and drives through it show of each other."""

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from sextant.data.places.image_rows import ImageRows
from sextant.data.places.images import PlaceImages
from sextant.data.places.split import SPLITS, Split
from sextant.data.rendered import RenderedSource
from sextant.errors import ArgumentError

#: shares of the map's positions that lie west of the border between two splits, and how wide a strip is left out there
BORDERS, STRIP_M = (0.7, 0.8), 40.0


class TownCitySource(RenderedSource):
    """The map of :class:`~sextant.data.worlds.TownCity`, and a drive under each of its conditions.

    An image of a drive lies up to half the map's spacing from an image of the map, on either side of the street, and
    looks up to half the map's turn beside it: places seen from elsewhere, where the traverses of
    :class:`~sextant.data.worlds.TownSeasons` return to about the same poses. Parts of the city from west to east are
    the training, validation and test split; a strip at each border is in none.
    """

    place_unit: Literal["m", "frames"] = "m"

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The map and the conditions of the config; nothing is rendered."""
        return ("map", *self.dataset.plan().condition_names)

    def read(self, split: Split) -> PlaceImages:
        """The images of a split, memory-mapped from their file, with positions and headings.

        Raises:
            UserError: the city has no drives, or so few images that a split has none.
        """
        mapped, driven = self.read_split("map", "images=20000"), self.read_split("query", "query_frames=1000")
        pose = np.concatenate([found.columns["pose"] for found in (mapped, driven)])
        here = _within(pose[:, 0], pose[: len(mapped.rows), 0], split)
        traverse = np.concatenate([np.zeros(len(mapped.rows), np.int64), 1 + driven.columns["condition"].astype(np.int64)])
        for number, condition in enumerate(self.conditions(split)):
            if not (here & (traverse == number)).any():
                raise ArgumentError(
                    f"the {split} part of this city has no image of {condition}",
                    "Make it larger, with more images: size_m=1000 images=20000 query_frames=2500",
                )
        frame = np.concatenate([np.arange(n) for n in np.bincount(traverse)])
        kept, names = np.flatnonzero(here), self.conditions(split)
        return PlaceImages(
            ImageRows(mapped.images, np.concatenate([mapped.rows, driven.rows])[kept]),
            traverse[kept],
            names,
            frame[kept],
            tuple(f"{split}/{names[traverse[row]]}/{frame[row]:06d}" for row in kept),
            np.ascontiguousarray(pose[kept, :2]),
            np.degrees(pose[kept, 3]),
            aligned=False,
        )


def _within(x: Float64[ndarray, "n"], mapped: Float64[ndarray, "k"], split: Split) -> Bool[ndarray, "n"]:
    """Whether positions lie in the part of a split, given those of the map."""
    number = SPLITS.index(split)
    west, east = np.quantile(mapped, BORDERS)
    low, high = (-np.inf, west, east)[number], (west, east, np.inf)[number]
    inside: Bool[ndarray, "n"] = (x > low + STRIP_M / 2) & (x < high - STRIP_M / 2)
    return inside
