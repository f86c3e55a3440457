"""The splits of a rendered dataset, which is rendered when the first split is read."""

import os
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Int64, UInt8
from numpy import ndarray

from sextant.data.rendered.plan import RenderPlan
from sextant.data.rendered.progress import Showing, notify_every
from sextant.data.rendered.store import open_store
from sextant.errors import UserError


class RenderedDataset(Protocol):
    """A dataset to render, and where it is stored.

    Attributes:
        name: of the dataset.
        cache: folder of stores.
    """

    name: str
    cache: Path

    def plan(self) -> Any:
        """A :class:`~sextant.data.rendered.RenderPlan` with the array ``images``, and names of ``splits`` that its
        column ``split`` numbers.
        """


@dataclass(frozen=True)
class RenderedSplit:
    """One split of a rendered dataset.

    Attributes:
        images: of all splits, memory-mapped from their file.
        rows: indices of this split's images, increasing.
        columns: values for the rows of this split.
        facts: about the whole dataset.
    """

    images: UInt8[ndarray, "n h w 3"]
    rows: Int64[ndarray, "k"]
    columns: dict[str, ndarray]
    facts: dict[str, Any]


class RenderedSource:
    """A rendered dataset as a source of splits; subclasses add how these are read.

    Args:
        dataset: what to render, and where it is stored.
        threads: number of rendering threads; None for one per core.

    Attributes:
        showing: makes a context with a function that is called during rendering with the numbers of images on disk and
            in all. By default it logs a line every few seconds.
    """

    def __init__(self, dataset: RenderedDataset, threads: int | None = None):
        self.dataset, self.threads = dataset, threads or os.cpu_count() or 1
        self.name = dataset.name
        self.showing: Showing = lambda: nullcontext(notify_every(5.0, f"rendering {dataset.name}"))

    def files(self, split: str) -> list[Path]:
        """An empty list: what is missing is rendered."""
        return []

    def fingerprint(self) -> str:
        """Hash of the config and of the source that renders it."""
        plan: RenderPlan = self.dataset.plan()
        return plan.digest

    def read_split(self, split: str, fix: str) -> RenderedSplit:
        """Read a split; all splits are rendered if they have not been.

        Args:
            split: its name.
            fix: what a user does if it has no images: ``dataset.frames.val=50``.

        Raises:
            UserError: the split has no images, or the store cannot be written to or is damaged.
        """
        plan = self.dataset.plan()
        store = open_store(plan, self.dataset.cache)
        if not store.complete:
            with self.showing() as progress:
                store.fill(progress, self.threads)
        rows = np.flatnonzero(store.columns["split"] == plan.splits.index(split))
        if not len(rows):
            raise UserError(f"dataset={self.name} has no {split} images", fix)
        images = store.mapped("images", rows, self.threads)
        columns = {name: column[rows] for name, column in store.columns.items()}
        return RenderedSplit(images, rows, columns, store.facts)
