"""Corrupted images from files in the layout of CIFAR-10-C: the authors' own, or those of ``sextant.corruptions make``.

A corruption drawn once serves every run that is tested under it, and the files of the benchmark's authors give figures
that are comparable image by image.
"""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Int64
from numpy.typing import NDArray
from torch import Tensor

from sextant.atomic_files import read_json
from sextant.corruptions.benchmark_suite import Names, benchmark_set
from sextant.corruptions.contract import Images, Indices, Positions, require_indices
from sextant.corruptions.making import LABELS, RECORD, read_array
from sextant.corruptions.suite import Condition, CorruptionSuite, Protocol
from sextant.errors import ArgumentError, UserError
from sextant.ranges import checked
from sextant.tables import counted

MAKE = "python -m sextant.corruptions make set={set} input=<dataset> output={folder}"


class StoredSuite(CorruptionSuite):
    """The conditions of a published set, read from ``<folder>/<corruption>.npy``.

    Each file holds uint8 images ``(s·n, h, w[, c])``: all n at the first severity, then all at the next;
    ``labels.npy`` repeats their labels likewise. Files are memory-mapped, never read whole, and nothing is unpickled.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(f"{folder}/labels.npy", np.zeros(10, np.int64))  # of two images, five times
    ...     np.save(f"{folder}/fog.npy", np.full((10, 32, 32, 3), 51, np.uint8))
    ...     suite = StoredSuite(folder, names=["fog"])
    >>> suite.corrupt(torch.zeros(1, 3, 32, 32), [1], Condition("fog", 3)).mean()  # 51 of 255
    tensor(0.2000)

    Args:
        folder: folder of the files.
        set: ``cifar10_c``, ``cifar100_c``, ``mnist_c`` or ``imagenet_c``: the set that names and severities belong to.
        names: corruptions to test: all that are published (``None``), a group, or a list of names.
        severities: some of those in the files; ``None`` for all.

    Raises:
        UserError: a file is missing, damaged, or holds other images than the test split of the run.
    """

    @checked
    def __init__(
        self,
        folder: str | Path,
        set: Literal["cifar10_c", "cifar100_c", "mnist_c", "imagenet_c"] = "cifar10_c",
        names: Names = None,
        severities: Any = None,
    ):
        self.folder, self.set = Path(folder).expanduser(), set
        chosen, record = benchmark_set(set), read_json(self.folder / RECORD) or {}
        recipe = dict(record.get("recipe") or {})
        if recipe.get("set", set) != set:
            raise ArgumentError(
                f"set={set}: {self.folder} holds corruptions of {recipe['set']}", f"set={recipe['set']}"
            )
        stored = dict(record.get("severities") or {})
        every = {name: replace(c, levels=tuple(stored.get(name, c.levels))) for name, c in chosen.build(names).items()}
        super().__init__(every if severities is None else chosen.build(names, severities), int(recipe.get("seed", 0)))
        self._levels: dict[str, list[Any]] = {name: list(corruption.levels) for name, corruption in every.items()}
        self.labels = self._open(LABELS)
        self.images = {name: self._images(name) for name in self.corruptions}
        self.protocol = Protocol(
            set=set,
            title=chosen.title,
            severities={name: tuple(c.levels) for name, c in self.corruptions.items()},
            mode=recipe.get("mode", "published"),
            rounding="8 bits, as stored",
            baseline=chosen.baseline,
            image_size=int(next(iter(self.images.values())).shape[1]),
            seed=self.seed,
        )

    def corrupt(self, images: Images, indices: Indices, condition: Condition) -> Images:
        """The stored versions of the images at positions ``indices`` of the test split, in [0, 1].

        Raises:
            ArgumentError: the suite has no such corruption, or the files no such severity.
            UserError: the files hold images of another shape, or too few; or there is not one index for each image.
        """
        if condition.corruption is None:
            return images
        self._named(name := condition.corruption)
        positions, levels = require_indices(indices, len(images)), self._levels[name]
        if condition.level not in levels:
            known = ", ".join(f"{level:g}" for level in levels)
            raise ArgumentError(f"level={condition.level} of {name} is not in its file", f"There are: {known}.")
        if len(images) == 0:
            return images.clone()
        stored = self.images[name]
        count = len(stored) // len(levels)
        if int(positions.max()) >= count:
            raise UserError(
                f"{self.folder} holds {counted(count, 'image')} per severity, the test split has more", self._remedy
            )
        rows = levels.index(condition.level) * count + positions.numpy()
        found = torch.from_numpy(np.ascontiguousarray(stored[rows]))
        found = found.unsqueeze(1) if found.ndim == 3 else found.permute(0, 3, 1, 2)
        if found.shape != images.shape:
            shapes = ["x".join(str(size) for size in shape) for shape in (found.shape[1:], images.shape[1:])]
            raise UserError(f"{self.folder} holds images of {shapes[0]}, the dataset {shapes[1]}", self._remedy)
        return found.to(images.device).contiguous().float() / 255

    def check_labels(self, labels: Int64[Tensor, "b"], indices: Positions) -> None:
        """Raise a ``UserError`` unless the stored images at ``indices`` have the classes ``labels``."""
        positions = indices.cpu().numpy()
        if int(positions.max()) >= len(self.labels) or (self.labels[positions] != labels.cpu().numpy()).any():
            raise UserError(f"{self.folder / LABELS} has other labels than the test split of the dataset", self._remedy)

    @property
    def _remedy(self) -> str:
        made = MAKE.format(set=self.set, folder="<another folder>")
        return f"Are they of another dataset, or in another order? {made}"

    def _images(self, name: str) -> NDArray[np.uint8]:
        stored, levels = self._open(f"{name}.npy"), self._levels[name]
        absent = [level for level in self.corruptions[name].levels if level not in levels]
        if absent:
            raise UserError(
                f"{self.folder / name}.npy has no severity {absent[0]}",
                f"It has {', '.join(f'{level:g}' for level in levels)}.",
            )
        if stored.dtype != np.uint8 or stored.ndim not in (3, 4) or len(stored) % len(levels):
            raise UserError(
                f"{self.folder / name}.npy holds {stored.dtype} of shape {stored.shape}",
                f"It must hold uint8 images (n, height, width[, channels]), at {len(levels)} severities in turn.",
            )
        return stored

    def _open(self, name: str) -> NDArray[Any]:
        path = self.folder / name
        if not path.exists():
            raise UserError(
                f"{self.folder} has no {name}",
                f"{MAKE.format(set=self.set, folder=self.folder)} writes it; "
                "or take the files of the benchmark's authors.",
            )
        return read_array(path, str(path))


def folder_identity(folder: str | Path) -> str:
    """Hash of what identifies a folder of stored corruptions: its record, labels, and the files' sizes and times.

    The files themselves take gigabytes and are not read.
    """
    path = Path(folder).expanduser()
    digest = hashlib.sha256()
    for small in (RECORD, LABELS):
        if (path / small).is_file():
            digest.update((path / small).read_bytes())
    for file in sorted(path.glob("*.npy")):
        status = file.stat()
        digest.update(f"{file.name} {status.st_size} {status.st_mtime_ns}".encode())
    return digest.hexdigest()
