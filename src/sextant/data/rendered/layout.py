"""Paths of a store's files, and the array files themselves."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from sextant.atomic_files import write_atomically
from sextant.data.rendered.plan import ArraySpec
from sextant.errors import UserError, command

BLOCK = 1 << 20


class DamagedStoreError(UserError):
    """A file of a store is not what it should be."""

    @classmethod
    def at(cls, path: Path, what: str) -> "DamagedStoreError":
        """The error for one file, with the command that repairs its store."""
        store = path.parent.parent if path.parent.name == "columns" else path.parent
        return cls(
            f"{path}: {what}",
            f"{command('data', 'verify', str(store), 'repair=true')}\n"
            "keeps the undamaged parts; the command that rendered the store then renders the rest.",
        )


@dataclass(frozen=True)
class StoreLayout:
    """The files of one store."""

    path: Path

    @property
    def manifest(self) -> Path:
        """The description of what the store holds; written last when a store is laid out."""
        return self.path / "manifest.json"

    @property
    def journal(self) -> Path:
        """The rendered chunks, one JSON object per line."""
        return self.path / "journal.jsonl"

    def array(self, name: str) -> Path:
        """The file of an array, which has its full size from the start."""
        return self.path / f"{name}.npy"

    def column(self, name: str) -> Path:
        """The file of a column."""
        return self.path / "columns" / f"{name}.npy"


def create_array(path: Path, spec: ArraySpec, count: int) -> None:
    """Write an array of zeros as a sparse file: a header, followed by a hole.

    Raises:
        OSError: the disk refused.
    """
    header = _header(spec, count)

    def write(file: BinaryIO) -> None:
        file.write(header)
        file.truncate(len(header) + count * spec.item_bytes)

    write_atomically(path, write)


def array_offset(path: Path, spec: ArraySpec, count: int) -> int:
    """Where the items of an array file begin.

    Raises:
        DamagedStoreError: the file is missing, or its header describes a different array.
    """
    expected = ((count, *spec.shape), False, np.dtype(spec.dtype))
    try:
        with path.open("rb") as file:
            version = npy.read_magic(file)
            read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            found = read(file)
            offset = file.tell()
    except FileNotFoundError:
        raise DamagedStoreError.at(path, "the file is missing") from None
    except (OSError, ValueError) as error:
        raise DamagedStoreError.at(path, f"not an array file: {error}") from None
    if found != expected:
        (shape, _, dtype), (wanted, _, wanted_dtype) = found, expected
        raise DamagedStoreError.at(path, f"holds {dtype} {shape}, the manifest requires {wanted_dtype} {wanted}")
    return offset


def check_array(path: Path, spec: ArraySpec, count: int) -> int:
    """Offset of the items in an array file, after checking the file's length.

    Raises:
        DamagedStoreError: it is missing, holds a different array, or has the wrong length.
    """
    offset = array_offset(path, spec, count)
    found, expected = path.stat().st_size, offset + count * spec.item_bytes
    if found != expected:
        raise DamagedStoreError.at(path, f"{found:,} bytes long, should be {expected:,}")
    return offset


def part_sha256(path: Path, start: int, length: int) -> str:
    """SHA-256 of a part of a file, read in blocks; anything beyond the end of the file is ignored.

    Raises:
        OSError: it cannot be read.
    """
    part = hashlib.sha256()
    with path.open("rb") as file:
        file.seek(start)
        while length > 0 and (block := file.read(min(BLOCK, length))):
            part.update(block)
            length -= len(block)
    return part.hexdigest()


def sound_items(path: Path, spec: ArraySpec, count: int) -> int:
    """Number of items that a file holds at its present length; 0 if the file is not this array."""
    try:
        offset = array_offset(path, spec, count)
    except DamagedStoreError:
        return 0
    return min(count, max(0, path.stat().st_size - offset) // spec.item_bytes)


def make_arrays(layout: StoreLayout, arrays: Mapping[str, ArraySpec], count: int) -> int:
    """Give every array a file of full length, keeping its content; returns how many leading items may be intact.

    Raises:
        OSError: the disk refused.
    """
    kept = count
    for name, spec in arrays.items():
        path = layout.array(name)
        sound = sound_items(path, spec, count)
        kept = min(kept, sound)
        if sound == 0:
            create_array(path, spec, count)
        else:
            with path.open("r+b") as file:
                file.truncate(array_offset(path, spec, count) + count * spec.item_bytes)
    return kept


def _header(spec: ArraySpec, count: int) -> bytes:
    buffer = BytesIO()
    description = {"descr": np.dtype(spec.dtype).str, "fortran_order": False, "shape": (count, *spec.shape)}
    npy.write_array_header_1_0(buffer, description)
    return buffer.getvalue()
