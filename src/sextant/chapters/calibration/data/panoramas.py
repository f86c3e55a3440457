"""Panoramas to crop, and where they come from: a rendered town, a folder, or several of these."""

import hashlib
import json
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.data.rendered import RenderedSource
from sextant.errors import ArgumentError, UserError

SMALLEST = 8  # rows of the coarsest level


def padded(panorama: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h+2 w+2 4"]:
    """A panorama with one more pixel on every side, and four channels.

    Columns wrap around the panorama, and the row beyond a pole is the row next to it, shifted by half a turn. An unused
    fourth channel is added because OpenCV samples four channels 2.6 times as fast as three.
    """
    import cv2

    half = panorama.shape[1] // 2
    out = cv2.copyMakeBorder(cv2.cvtColor(panorama, cv2.COLOR_RGB2RGBA), 1, 1, 1, 1, cv2.BORDER_WRAP)
    out[0, 1:-1], out[-1, 1:-1] = (np.roll(out[row, 1:-1], half, axis=0) for row in (1, -2))
    out[:, 0], out[:, -1] = out[:, -2], out[:, 1]
    return np.asarray(out)


def halved(panorama: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h/2 w/2 3"]:
    """Halve a panorama: each pixel is the mean of the four that it covers, or of its area if the size is odd."""
    import cv2

    height, width = panorama.shape[:2]
    return np.asarray(cv2.resize(panorama, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_AREA))


def top_level(height: int) -> int:
    """Number of the coarsest level of a panorama of ``height`` rows; 0 is the panorama itself."""
    return max(0, (height // SMALLEST).bit_length() - 1)


class Kept:
    """A cache of arrays by key that drops the least recently used ones beyond a number of bytes.

    Args:
        most_bytes: limit for all arrays together.
    """

    def __init__(self, most_bytes: int):
        self.most_bytes = most_bytes
        self._values: OrderedDict[object, ndarray] = OrderedDict()
        self._bytes = 0
        self._lock = Lock()

    def get(self, key: object, make: Callable[[], ndarray]) -> ndarray:
        """The array of a key, made if it is not cached."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        value = make()
        with self._lock:
            if key not in self._values:
                self._values[key] = value
                self._bytes += value.nbytes
            while self._bytes > self.most_bytes and len(self._values) > 1:
                _, oldest = self._values.popitem(last=False)
                self._bytes -= oldest.nbytes
        return value

    def __reduce__(self) -> tuple[type["Kept"], tuple[int]]:
        return type(self), (self.most_bytes,)  # another process starts with an empty cache


Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = get_args(Split)
#: bytes of resized panoramas that are kept in memory
KEPT_BYTES = 2 * 2**30


class Panoramas:
    """Panoramas of one split, and their pyramids.

    Args:
        images: upright panoramas ``(h, w, 3)`` of any sizes, or an array ``(n, h, w, 3)`` that may lie on disk.
        names: one for each.
        rows: indices of the images used, in order, possibly repeated; None for all.
    """

    def __init__(
        self,
        images: Sequence[UInt8[ndarray, "h w 3"]] | UInt8[ndarray, "n h w 3"],
        names: Sequence[str],
        rows: Sequence[int] | ndarray | None = None,
    ):
        self.images = np.asarray(images) if isinstance(images, np.ndarray) else images  # plain views of maps are faster
        self.names = tuple(names)
        self._rows = np.arange(len(images)) if rows is None else np.asarray(rows, np.int64)
        if len(self._rows) != len(self.names):
            raise ValueError(f"{len(self._rows)} panoramas with {len(self.names)} names")
        self._levels = Kept(KEPT_BYTES)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, i: int) -> UInt8[ndarray, "h w 3"]:
        return np.asarray(self.images[self._rows[i]])

    def level(self, i: int, level: int) -> UInt8[ndarray, "h w 4"]:
        """Panorama ``i`` halved ``level`` times and padded; computed once and kept within :data:`KEPT_BYTES`."""
        return self._levels.get((int(self._rows[i]), level), lambda: padded(self._halved(i, level)))

    def _halved(self, i: int, level: int) -> ndarray:
        image = self[i]
        for _ in range(level):  # intermediate levels are not kept: they are often larger, and unused
            image = halved(image)
        return image


@runtime_checkable
class PanoramaSource(Protocol):
    """A dataset of panoramas in three splits.

    Attributes:
        name: name of the dataset in messages.
    """

    name: str

    def files(self, split: Split) -> list[Path]:
        """The files that ``split`` is read from; nothing is rendered or decoded.

        Raises:
            UserError: the files are missing.
        """

    def fingerprint(self) -> str:
        """Hash that changes when the data does."""

    def read(self, split: Split) -> Panoramas:
        """The panoramas of a split.

        Raises:
            UserError: a file cannot be read; the message names it.
        """


class TownPanoramaSource(RenderedSource):
    """The rendered panoramas of :class:`~sextant.data.worlds.TownPanoramas`."""

    def read(self, split: Split) -> Panoramas:
        """The panoramas of a split, memory-mapped from their file."""
        found = self.read_split(split, f"images.{split}=16")
        towns = zip(found.columns["scene"], found.rows, strict=True)
        return Panoramas(found.images, [f"town_{town:02d}__{row:05d}" for town, row in towns], found.rows)


class PanoramaMix:
    """Several sources joined, split by split.

    Args:
        sources: sources to join, by name: datasets with panoramas, or functions of ``roots`` that make one
            (``_partial_: true`` in a config).
        repeats: how often the training panoramas of a source are shown in an epoch; once for sources not named.
        roots: passed to these functions.

    Raises:
        UserError: there is no source, ``repeats`` names an unknown one, or a number of repeats is below 1.
    """

    def __init__(
        self, sources: Mapping[str, Any], repeats: Mapping[str, int] | None = None, roots: Sequence[Path | str] = ()
    ):
        if not sources:
            raise ArgumentError("sources is empty: a mix of panoramas needs at least one source")
        repeats = dict(repeats or {})
        for name, count in repeats.items():
            if name not in sources or count < 1:
                raise ArgumentError(
                    f"repeats.{name}={count}: it takes whole numbers above 0 for {', '.join(sources)}",
                    f"repeats.{next(iter(sources))}=2",
                )
        self.repeats = [repeats.get(name, 1) for name in sources]
        made = [source(roots=roots) if isinstance(source, partial) else source for source in sources.values()]
        self.sources = [as_panorama_source(source) for source in made]
        self.name = "+".join(source.name for source in self.sources)

    def files(self, split: Split) -> list[Path]:
        """The files of all sources."""
        return [path for source in self.sources for path in source.files(split)]

    def fingerprint(self) -> str:
        """Hash of the fingerprints of all sources."""
        prints: list[Any] = [source.fingerprint() for source in self.sources]
        if any(count > 1 for count in self.repeats):
            prints.append(self.repeats)
        return hashlib.sha256(json.dumps(prints).encode()).hexdigest()

    def read(self, split: Split) -> Panoramas:
        """The panoramas of all sources, one after the other."""
        images: list[Any] = []
        names: list[str] = []
        rows: list[int] = []
        for source, count in zip(self.sources, self.repeats, strict=True):
            part = source.read(split)
            again = count if split == "train" else 1
            rows += again * list(range(len(images), len(images) + len(part)))
            images += [part[i] for i in range(len(part))]
            names += again * [f"{source.name}/{name}" for name in part.names]
        return Panoramas(images, names, rows)


def panorama_count(source: PanoramaSource, split: Split) -> int | None:
    """Number of panoramas in a split, with the repeats of training; None if unknown without reading them."""
    if isinstance(source, PanoramaMix):
        counts = [panorama_count(part, split) for part in source.sources]
        repeats = source.repeats if split == "train" else [1] * len(counts)
        known = [count * again for count, again in zip(counts, repeats, strict=True) if count is not None]
        return sum(known) if len(known) == len(counts) else None
    if isinstance(source, TownPanoramaSource):
        return int(source.dataset.config["images"][split])  # type: ignore[attr-defined]
    return len(source.files(split)) or None


def rendered_sources(source: PanoramaSource) -> list[TownPanoramaSource]:
    """The parts of a source that are rendered."""
    if isinstance(source, PanoramaMix):
        return [town for part in source.sources for town in rendered_sources(part)]
    return [source] if isinstance(source, TownPanoramaSource) else []


def as_panorama_source(dataset: Any) -> PanoramaSource:
    """A dataset as a source of panoramas.

    Raises:
        UserError: it has no panoramas.
    """
    if hasattr(dataset, "plan"):  # a rendered world: its modules are loaded anyway
        from sextant.data.worlds.towns import TownPanoramas

        if isinstance(dataset, TownPanoramas):
            return TownPanoramaSource(dataset)
    elif isinstance(dataset, PanoramaSource) and not hasattr(dataset, "spec"):
        return dataset
    name = getattr(dataset, "name", type(dataset).__name__)
    raise UserError(
        f"dataset={name} has no panoramas, which task=calibration needs",
        "Choose town_panoramas (rendered here) or panorama_folder (your own).",
    )
