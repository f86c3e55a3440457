"""Known cameras beside photos, and datasets in their published layout."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from sextant.data.photos.header import PhotoHeader
from sextant.user_files import table_header

#: files of a dataset in its published layout, below the folder that ``paths.data`` names
STANDARD = {
    "dataset=mnist": "MNIST/raw/train-images-idx3-ubyte",
    "dataset=cifar10": "cifar-10-batches-py/data_batch_5",
    "task=localization dataset=cold": "cold/seq1_night1.json",
}


def known_cameras(folder: Path, tables: Sequence[Path], headers: Mapping[Path, PhotoHeader]) -> dict[Path, str]:
    """Folders of photos with known cameras, and the files that state them.

    See :mod:`sextant.data.calibration.known_photos`.
    """
    found: dict[Path, str] = {}
    for file in tables:
        beside = any(each.is_relative_to(file.parent) for each in headers)
        if beside and (file.name in ("K.txt", "calibration_computed.json") or "f_px" in _columns(folder / file)):
            found.setdefault(file.parent, file.name)
    return found


def level_panoramas(folder: Path, tables: Sequence[Path], panoramas: Sequence[Path]) -> dict[Path, str]:
    """Folders with a table of panoramas that has a column ``file``, but no cameras."""
    inside = {path.parent for path in panoramas}
    columns = {file: _columns(folder / file) for file in tables if file.parent in inside}
    return {file.parent: file.name for file, names in columns.items() if "file" in names and "f_px" not in names}


def standard_sets(folder: Path) -> dict[str, Path]:
    """Options for each published dataset in a folder, or that the folder is part of, with its ``paths.data``."""
    here = folder.resolve()
    found: dict[str, Path] = {}
    for overrides, file in STANDARD.items():
        for base in (here, *here.parents[:2]):
            whole = base / file
            if os.path.isfile(whole) and whole.is_relative_to(here):  # False without permission to look
                found[overrides] = base
    return found


def _columns(path: Path) -> set[str]:
    """The column names of a CSV file; empty for any other file."""
    if path.suffix.lower() != ".csv":
        return set()
    return set(table_header(path))
