"""Arrays in the cache: written completely or not at all, hashed in a separate file, and not opened if altered."""

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy import ndarray

from sextant.atomic_files import hash_file, write_atomically


def open_kept(path: Path, shape: tuple[int | None, ...], dtype: type[np.generic]) -> ndarray | None:
    """Open an array of the cache, memory-mapped.

    Args:
        path: the ``.npy`` file.
        shape: shape that the array must have; None stands for any length.
        dtype: dtype that the array must have.

    Returns:
        The array, or None if there is no such file or it was altered. Complete files from before hashes were stored
        are accepted.
    """
    try:
        found = np.load(path, mmap_mode="r", allow_pickle=False)
        if not isinstance(found, ndarray) or found.dtype != dtype or found.ndim != len(shape):
            return None
        if any(want is not None and want != have for want, have in zip(shape, found.shape, strict=True)):
            return None
        seal = _seal(path)
        return found if not seal.is_file() or seal.read_text().strip() == hash_file(path) else None
    except (OSError, ValueError, EOFError):
        return None


def keep_array(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Let ``write`` write an array in the ``.npy`` format, and keep it with its hash.

    Raises:
        OSError: the disk is full or not writable; no partial file is left.
    """
    _seal(path).unlink(missing_ok=True)  # a kill in between leaves a complete file without a hash
    write_atomically(path, write)
    digest = hash_file(path)
    write_atomically(_seal(path), lambda file: file.write(f"{digest}\n".encode()))


def _seal(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")
