"""The interface of labelled image datasets: files that can be checked, hashed and read."""

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Int64, UInt8
from numpy import ndarray

from sextant.atomic_files import file_sha256
from sextant.errors import ArgumentError, UserError
from sextant.user_files import nearest_path

Split = Literal["train", "test"]
SPLITS: tuple[Split, ...] = ("train", "test")


class MissingDataError(ArgumentError):
    """The files of a dataset were not found."""


@dataclass(frozen=True)
class ImageSpec:
    """Shape of the images of a dataset, and its classes in label order."""

    channels: int
    height: int
    width: int
    classes: tuple[str, ...]


@dataclass(frozen=True)
class LabelledImages:
    """Images of one split with their labels, as stored in memory."""

    images: UInt8[ndarray, "n c h w"]
    labels: Int64[ndarray, "n"]


class ImageSource(ABC):
    """A dataset of labelled images with a training and a test split.

    Sources import nothing heavier than numpy and Pillow, so that a missing or damaged file is found at once.

    Attributes:
        name: the dataset's name in messages.
    """

    name: str

    @abstractmethod
    def files(self, split: Split) -> list[Path]:
        """The files that ``split`` is read from.

        Raises:
            MissingDataError: they were not found; the message names the searched folders, how to get the files,
                and what to use instead.
        """

    @abstractmethod
    def spec(self) -> ImageSpec:
        """Image shape and class names."""

    @abstractmethod
    def read(self, split: Split) -> LabelledImages:
        """Read a split, checking that every file is intact.

        Raises:
            UserError: a file is missing, truncated or altered; the message names it.
        """

    def count(self, split: Split) -> int | None:
        """Number of images of a split, if known before they are read."""
        return None

    def fingerprint(self) -> str:
        """Hash of the names and contents of all files, which changes when the data does."""
        entries: list[tuple[str, ...]] = []
        for split in SPLITS:
            try:
                files = self.files(split)
            except MissingDataError:  # the test split alone is enough for evaluation
                entries.append((split, "absent"))
                continue
            entries += [(split, path.parent.name, path.name, file_sha256(path)) for path in files]
        return hashlib.sha256(json.dumps(entries).encode()).hexdigest()


def first_folder(looked: Sequence[Path], key: str, fix: str) -> Path:
    """The first of the searched paths that is a folder.

    Raises:
        MissingDataError: none is; the message names ``key``, all the paths and what to do.
    """
    for path in looked:
        if path.is_dir():
            return path
    places = "\n".join(f"  {path}" for path in dict.fromkeys(looked))
    near = next(filter(None, map(nearest_path, looked)), None)
    hint = f"Did you mean {near}? " if near else ""
    raise MissingDataError(f"{key}: no such folder. Looked for\n{places}", f"{hint}{fix}")


def find_folder(roots: Sequence[Path | str], folder: str, names: Sequence[str], *, dataset: str, source: str) -> Path:
    """The first ``root/folder`` that holds all files in ``names``.

    Raises:
        MissingDataError: there is none.
    """
    folders = [Path(root) / folder for root in roots]
    for path in folders:
        if all((path / name).is_file() for name in names):
            return path
    missing = [name for name in names if not (folders[0] / name).is_file()]
    looked = "\n".join(f"  {path}" for path in folders)
    raise MissingDataError(
        f"dataset={dataset}: {', '.join(missing)} not found. Looked in\n{looked}",
        f"Put the files there ({source}), set SEXTANT_DATA to the folder that holds {folder}, or let\n"
        "torchvision fetch them with download=true. Without any download: dataset=digits",
    )


def check_file(path: Path, digest: str, algorithm: Literal["md5", "sha256"] = "sha256") -> None:
    """Check that a file is the published one.

    Raises:
        UserError: its hash differs; the message names the file, its size and both hashes.
    """
    with path.open("rb") as file:
        found = hashlib.file_digest(file, algorithm).hexdigest()
    if found != digest:
        raise UserError(
            f"{path} is damaged or not the published file: {path.stat().st_size:,} bytes, "
            f"{algorithm} {found}, expected {digest}",
            "Delete it and fetch it again.",
        )


def channels_first(images: UInt8[ndarray, "n h w *c"]) -> UInt8[ndarray, "n c h w"]:
    """Grey ``(n, h, w)`` or colour ``(n, h, w, c)`` images as contiguous ``(n, c, h, w)``."""
    stacked = images[:, None] if images.ndim == 3 else images.transpose(0, 3, 1, 2)
    return np.ascontiguousarray(stacked)
