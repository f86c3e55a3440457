"""Folders of arrays with a header that describes them: how they are recognised, checked and rejected.

The header is a JSON file that is written last, so an interrupted write leaves a folder without one. The arrays are
``.npy`` files, which are memory-mapped and never unpickled. The header holds the hash of each array and one of itself;
older headers lack the latter.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy import ndarray

from sextant.atomic_files import hash_file, read_json, seal_holds, write_sealed_json
from sextant.errors import ArgumentError, UserError, shown


@dataclass(frozen=True)
class FolderFormat:
    """One kind of folder.

    Attributes:
        what: what the folder holds, with its article: ``a map``.
        format, version: what its header must state.
        header: file name of the header.
    """

    what: str
    format: str
    version: int
    header: str

    @property
    def noun(self) -> str:
        """``what`` without the article."""
        return self.what.partition(" ")[2]

    def write_header(self, folder: Path, header: Mapping[str, Any]) -> None:
        """Write the header of a folder in which everything else has been written.

        Args:
            folder: folder to write into.
            header: its content without format and version; it holds the hash of each array.

        Raises:
            OSError: the folder cannot be written.
        """
        write_sealed_json(folder / self.header, {"format": self.format, "version": self.version, **header})

    def read_header(self, folder: Path) -> dict[str, Any]:
        """Read the header of a folder.

        Raises:
            UserError: there is no such folder or no header in it, or the header has another format or version or was
                altered.
        """
        path = folder / self.header
        if not path.is_file():
            there = "there is no such folder" if not folder.is_dir() else f"the folder has no {self.header}"
            raise UserError(
                f"{folder} is not a saved {self.noun}: {there}", f"Name the folder that {self.what} was saved to."
            )
        header = read_json(path)
        if not isinstance(header, dict) or header.get("format") != self.format:
            raise UserError(
                f"{path} is not the header of {self.what}: its format is not {self.format!r}", "Name another folder."
            )
        if header.get("version") != self.version:
            raise UserError(
                f"{path} has version {header.get('version')!r}; this program reads version {self.version}",
                f"Rebuild the {self.noun} from its images.",
            )
        if not seal_holds(header):
            raise self.damaged(folder, f"{path} was altered: it does not match its own hash")
        return header

    def open_array(
        self, folder: Path, path: Path, mapped: Literal["r", "c"] | None, *, sha256: str | None, size: int | None = None
    ) -> ndarray:
        """Open an array of a folder after checking that the header was written for it.

        Args:
            folder: the folder, for error messages.
            path: the array's file.
            mapped: memory-map the file, read-only (``r``) or copy-on-write (``c``); None reads it into memory.
            sha256: expected hash of the file; None skips this check, which reads the whole file.
            size: expected size of the file in bytes, if it is known.

        Raises:
            UserError: the file is missing, is not the expected one, or holds no array.
        """
        try:
            if size is not None and path.stat().st_size != size:
                raise self.damaged(folder, f"{path} has {path.stat().st_size} bytes; {size} were written")
            if sha256 is not None and hash_file(path) != sha256:  # before any of its content is interpreted
                raise self.damaged(folder, f"{path} is not the file that {self.header} was written for")
            return np.asanyarray(np.load(path, mmap_mode=mapped, allow_pickle=False))
        except (OSError, ValueError, TypeError, EOFError) as error:
            raise self.damaged(folder, f"{path} cannot be read: {error}") from error

    def damaged(self, folder: Path, how: str) -> UserError:
        """The error to raise for a damaged folder."""
        return UserError(
            f"the {self.noun} in {folder} is damaged: {how}", "Rebuild it from its images, or copy it again."
        )


def plain_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as JSON holds them: numbers and arrays of NumPy become plain ones.

    Raises:
        ArgumentError: JSON cannot hold one of them; the message names it.

    Example:
        >>> plain_values({"images": np.int64(3), "size": (24, 32)})
        {'images': 3, 'size': [24, 32]}
    """
    result = {}
    for name, value in values.items():
        try:
            result[name] = json.loads(json.dumps(value, default=lambda each: each.tolist()))
        except (AttributeError, TypeError, ValueError):
            raise ArgumentError(
                f"{name}={shown(value)} cannot be written as JSON", "Give numbers, texts, or lists of these."
            ) from None
    return result
