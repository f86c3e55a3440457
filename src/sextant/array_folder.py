"""Folders of arrays with a header that says what they are: how they are recognised, checked and refused.

The header is a JSON file that is written last, so that a folder in which writing was broken off has none; the arrays
are ``.npy`` files, which are mapped into memory and never unpickled. The header has the hash of each array and one of
itself; older headers have none of themselves.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy import ndarray

from sextant.atomic_files import read_json, seal_holds, write_sealed_json
from sextant.errors import UserError


@dataclass(frozen=True)
class FolderFormat:
    """One kind of folder.

    Attributes:
        what: it holds, with its article: ``a map``.
        format, version: that its header must have.
        header: name of that file.
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
        """Make one of this kind of a folder in which everything else lies.

        Args:
            folder: that it is written into.
            header: but for format and version; of each array it has the hash.

        Raises:
            OSError: the folder cannot be written.
        """
        write_sealed_json(folder / self.header, {"format": self.format, "version": self.version, **header})

    def read_header(self, folder: Path) -> dict[str, Any]:
        """The header of a folder.

        Raises:
            UserError: there is no such folder, no header in it, one of another format or version, or an altered one.
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
        """An array of a folder, once it is known to be the one that the header was written for.

        Args:
            folder: for the message.
            path: of the file.
            mapped: into memory, to be read only or copied where it is written to; None reads it.
            sha256: of the file; None not to read it all.
            size: of the file in bytes, if it is known.

        Raises:
            UserError: the file is missing, is another one, or holds no array.
        """
        try:
            if size is not None and path.stat().st_size != size:
                raise self.damaged(folder, f"{path} has {path.stat().st_size} bytes; {size} were written")
            if sha256 is not None and file_sha256(path) != sha256:  # before anything of it is interpreted
                raise self.damaged(folder, f"{path} is not the file that {self.header} was written for")
            return np.asanyarray(np.load(path, mmap_mode=mapped, allow_pickle=False))
        except (OSError, ValueError, TypeError, EOFError) as error:
            raise self.damaged(folder, f"{path} cannot be read: {error}") from error

    def damaged(self, folder: Path, how: str) -> UserError:
        """What to raise of a folder that was one once."""
        return UserError(
            f"the {self.noun} in {folder} is damaged: {how}", "Rebuild it from its images, or copy it again."
        )


def file_sha256(path: Path) -> str:
    """The hash of a file, read in pieces.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
