"""The rendered drives of a town as places."""

import os
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from sextant.data.calibration.panoramas import Showing, telling_every
from sextant.data.places.images import ImageRows, PlaceImages
from sextant.data.places.source import Split
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.data.worlds.towns import TownSeasons


class TownSeasonsSource:
    """The traverses of :class:`~sextant.data.worlds.TownSeasons`; rendered when they are first read.

    Each split is a town of its own. Frame ``i`` of every traverse is about the same place, and places that a drive
    comes to again have other frames but the same position: metres are the better unit.

    Args:
        dataset: what to render, and where it is kept.
        threads: that render; None for one a core.

    Attributes:
        showing: makes a context with a function that is called with the number of images on disk and of all while they
            are rendered; a line on the standard error every few seconds unless it is replaced.
    """

    place_unit: Literal["m", "frames"] = "m"

    def __init__(self, dataset: "TownSeasons", threads: int | None = None):
        self.dataset, self.threads = dataset, threads or os.cpu_count() or 1
        self.name = dataset.name
        self.showing: Showing = lambda: nullcontext(telling_every(5.0, f"rendering {dataset.name}"))

    def files(self, split: Split) -> list[Path]:
        """None: what is missing is rendered."""
        return []

    def fingerprint(self) -> str:
        """Hash of the config and of the source that renders it."""
        return self.dataset.plan().digest

    def read(self, split: Split) -> PlaceImages:
        """The images of a split, in a map of the file they lie in, with positions and headings."""
        from sextant.data.rendered import open_store
        from sextant.data.rendered.layout import StoreLayout

        plan = self.dataset.plan()
        store = open_store(plan, self.dataset.cache)
        if not store.complete:
            with self.showing() as progress:
                store.fill(progress, self.threads)
        columns = store.columns
        rows = np.flatnonzero(columns["split"] == plan.splits.index(split))
        if not len(rows):
            raise UserError(f"dataset={self.name} has no {split} frames", f"dataset.frames.{split}=300")
        traverse, frame = columns["condition"][rows].astype(np.int64), columns["place"][rows].astype(np.int64)
        pose = columns["pose"][rows]
        conditions = tuple(store.facts["conditions"])
        return PlaceImages(
            ImageRows(np.load(StoreLayout(store.directory).array("images"), mmap_mode="r", allow_pickle=False), rows),
            traverse,
            conditions,
            frame,
            tuple(f"{split}/{conditions[t]}/{i:05d}" for t, i in zip(traverse, frame, strict=True)),
            np.ascontiguousarray(pose[:, :2]),
            np.degrees(pose[:, 3]),
        )
