"""The splits of a rendered dataset, which is rendered when the first split is read."""

import hashlib
import os
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Int64, UInt8
from numpy import ndarray

from sextant.data.rendered.lock import Showing, notify_every
from sextant.data.rendered.plan import RenderPlan
from sextant.data.rendered.store import open_store
from sextant.errors import UserError

#: hashes of two sources that render the same bytes: the present one, and an earlier one that stands for both, so that
#: what it rendered is found again; ``python tests/frozen/renders_as.py <commit>`` compares them
SAME_BYTES = (
    "9e05a82163121b6eda72fc5c7f71d780733c3a154ff263613f6938299eefa3f4",
    "183c795ee6a352581255d272faf2518305c56ffefe0472fde844ab55091c3889",
)


def modules_sha256(*names: str) -> str:
    """SHA-256 over the source of modules and whole packages, by import path, without executing the modules; or that of
    an earlier source that renders the same bytes.

    Example: ``modules_sha256("sextant.worlds", "sextant.geometry", __name__)``. The parent packages of a module are
    imported to find it.

    Raises:
        ModuleNotFoundError: there is no such module.
    """
    return _modules_sha256(tuple(sorted(set(names))))


@cache
def _modules_sha256(names: tuple[str, ...]) -> str:
    tree = hashlib.sha256()
    for name in names:
        for label, path in _files(name):
            tree.update(label.encode() + b"\0" + path.read_bytes() + b"\0")
    found = tree.hexdigest()
    return SAME_BYTES[1] if found == SAME_BYTES[0] else found


def _files(name: str) -> Iterable[tuple[str, Path]]:
    spec = find_spec(name)
    if spec is None or (spec.origin is None and not spec.submodule_search_locations):
        raise ModuleNotFoundError(f"no module named {name!r}", name=name)
    if not spec.submodule_search_locations:
        return [(name, Path(str(spec.origin)))]
    roots = [Path(root) for root in spec.submodule_search_locations]
    return [
        (f"{name}/{path.relative_to(root).as_posix()}", path) for root in roots for path in sorted(root.rglob("*.py"))
    ]


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
            fix: advice if it has no images: ``dataset.frames.val=50``.

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
