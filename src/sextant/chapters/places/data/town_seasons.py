"""The rendered drives of a town as places."""

from typing import Literal

import numpy as np

from sextant.chapters.places.data.image_rows import ImageRows
from sextant.chapters.places.data.images import PlaceImages
from sextant.chapters.places.data.split import Split
from sextant.data.rendered import RenderedSource


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
