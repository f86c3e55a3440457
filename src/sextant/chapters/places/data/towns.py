"""Rendered towns as places, by season; and a rendered city, by a map of all directions and drives through it."""

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from sextant.chapters.places.data.image_rows import ImageRows
from sextant.chapters.places.data.images import SPLITS, PlaceImages, Split
from sextant.data.rendered import RenderedSource
from sextant.errors import ArgumentError


class TownSeasonsSource(RenderedSource):
    """The traverses of :class:`~sextant.data.worlds.TownSeasons`.

    Each split is a different town. Frame ``i`` of every traverse is about the same place, and places that a drive
    revisits have other frames but the same position: metres are the better unit.
    """

    place_unit: Literal["m", "frames"] = "m"

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The conditions of the config, the map's first; nothing is rendered."""
        return tuple(self.dataset.plan().condition_names)

    def read(self, split: Split) -> PlaceImages:
        """The images of a split, memory-mapped from their file, with positions and headings."""
        found = self.read_split(split, f"frames.{split}=300")
        traverse, frame = (found.columns[name].astype(np.int64) for name in ("condition", "place"))
        conditions = tuple(found.facts["conditions"])
        pose = found.columns["pose"]
        return PlaceImages(
            ImageRows(found.images, found.rows),
            traverse,
            conditions,
            frame,
            tuple(f"{split}/{conditions[t]}/{i:05d}" for t, i in zip(traverse, frame, strict=True)),
            np.ascontiguousarray(pose[:, :2]),
            np.degrees(pose[:, 3]),
        )


#: shares of the map's images that lie west of the border between two splits, and the width of the strip left out there
BORDERS, STRIP_M = (0.7, 0.8), 40.0
#: the traverse of the city's map
MAP = "map"


class TownCitySource(RenderedSource):
    """The map of :class:`~sextant.data.worlds.TownCity`, and a drive under each of its conditions.

    Most images of a drive lie within 7 m of an image of the map, along the street or across it, and differ from it in
    heading by up to half the map's angular step: viewpoints change, whereas the traverses of
    :class:`~sextant.data.worlds.TownSeasons` return to about the same poses. Parts of the city from west to east are
    the training, validation and test split; a strip at each border is in none. The frames of the map turn on the
    spot at each position, and drives leave a split and return: they do not form sequences.
    """

    place_unit: Literal["m", "frames"] = "m"

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The map and the conditions of the config; nothing is rendered."""
        return (MAP, *self.dataset.plan().condition_names)

    def read(self, split: Split) -> PlaceImages:
        """The images of a split, memory-mapped from their file, with positions and headings.

        Raises:
            UserError: a split has no image of the map or of a drive, which is reported before any rendering; or a
                condition is called ``map``.
        """
        names = self.conditions(split)
        if names.count(MAP) > 1:
            raise ArgumentError(f"conditions: the name {MAP!r} is reserved for the city's map", "Give it another name")
        columns = self.dataset.plan().columns
        pose, traverse = columns["pose"], np.where(columns["split"] == 0, 0, 1 + columns["condition"]).astype(np.int64)
        for part in SPLITS:
            self._check(part, names, traverse[_within(pose[:, 0], pose[traverse == 0, 0], part)])
        rows = np.flatnonzero(_within(pose[:, 0], pose[traverse == 0, 0], split))
        frame = np.concatenate([np.arange(count) for count in np.bincount(traverse)])
        self.read_split("map", "images=20000")
        images = self.read_split("query", "query_frames=2500").images
        return PlaceImages(
            ImageRows(images, rows),
            traverse[rows],
            names,
            frame[rows],
            tuple(f"{split}/{names[traverse[row]]}/{frame[row]:06d}" for row in rows),
            np.ascontiguousarray(pose[rows, :2]),
            np.degrees(pose[rows, 3]),
            aligned=False,
            drives=False,
        )

    def _check(self, split: Split, names: tuple[str, ...], traverse: Int64[ndarray, "k"]) -> None:
        missing = [name for number, name in enumerate(names) if not (traverse == number).any()]
        if missing:
            raise ArgumentError(
                f"no image of {', '.join(missing)} lies in the {split} part of this city",
                "Let drives cover the city, for example size_m=1000 images=20000 query_frames=2500 query_step_m=8.0",
            )


def _within(x: Float64[ndarray, "n"], mapped: Float64[ndarray, "k"], split: Split) -> Bool[ndarray, "n"]:
    """Whether positions lie in the part of a split, given those of the map."""
    number = SPLITS.index(split)
    west, east = np.quantile(mapped, BORDERS)
    low, high = (-np.inf, west, east)[number], (west, east, np.inf)[number]
    inside: Bool[ndarray, "n"] = (x > low + STRIP_M / 2) & (x < high - STRIP_M / 2)
    return inside
