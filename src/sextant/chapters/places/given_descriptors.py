"""Descriptors that were computed elsewhere: arrays, or files of ``numpy.save``, one row per image."""

from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray

from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.errors import ArgumentError, UserError, shown
from sextant.tables import counted

#: rows checked at a time, so that a file larger than memory is not read at once
ROWS = 4096


class GivenDescriptors:
    """Stands for a descriptor that Sextant does not have, by the length of its vectors.

    Args:
        dimension: number of values of a vector.

    Example:
        >>> GivenDescriptors(4096).model
        'descriptors of 4096 numbers, computed elsewhere'
    """

    size = ImageSize(64, 96)  # no image is ever described

    def __init__(self, dimension: int):
        self.dimension = dimension
        self.model = f"descriptors of {dimension} numbers, computed elsewhere"

    def describe(self, images: Any) -> NoReturn:
        """Raise a ``UserError``: images cannot be described."""
        raise UserError(
            f"the map has {self.model}, and photos cannot be described here",
            "Give the photos' descriptors: look_up_descriptors(<file>.npy), or descriptors=<map>.npy,<queries>.npy",
        )


def open_rows(path: Path, key: str) -> ndarray:
    """The array in a file, memory-mapped; nothing is unpickled.

    Raises:
        UserError: the file is no array, or holds a single number.
    """
    try:
        rows: ndarray = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{key}: {path} cannot be read: {error}", "Write it with numpy.save.") from None
    if not isinstance(rows, np.ndarray):
        raise UserError(f"{key}: {path} holds several arrays", "Write one array with numpy.save, not numpy.savez.")
    if not rows.ndim:
        raise UserError(f"{key}: {path} holds a single number", "Write one row per image with numpy.save.")
    return rows


def checked_rows(rows: ndarray, named: str, count: int | None, fix: str) -> Float32[ndarray, "n d"]:
    """Rows as 32-bit floats.

    Args:
        rows: one per image.
        named: the file or argument, for messages.
        count: number of images; None for any.
        fix: what to do about a wrong number.

    Raises:
        UserError: they are not as many rows of floats, or a row is not finite.
    """
    if rows.ndim != 2 or rows.dtype.kind != "f" or not rows.size or count not in (None, len(rows)):
        needed = "rows" if count is None else f"{counted(count, 'row')}"
        raise UserError(
            f"{named} has shape {rows.shape} of {rows.dtype}; {needed} of floats are needed, one per image", fix
        )
    told = np.empty(rows.shape, np.float32)
    for start in range(0, len(rows), ROWS):
        told[start : start + ROWS] = rows[start : start + ROWS]
    good = np.concatenate([np.isfinite(told[k : k + ROWS]).all(axis=1) for k in range(0, len(told), ROWS)])
    if len(bad := np.flatnonzero(~good)):
        raise UserError(
            f"{named}: {len(bad):,} of {counted(len(told), 'row')} {'is' if len(bad) == 1 else 'are'} not finite, the "
            f"first is row {bad[0]}, counted from 0",
            "Describe these images again, or leave them out.",
        )
    return told


def given_rows(
    descriptors: Float[ndarray, "n d"] | Path | str, count: int | None, key: str = "descriptors"
) -> Float32[ndarray, "n d"]:
    """Descriptors given as an array or as a file.

    Args:
        descriptors: one row per photo, in the order of the photos (of a folder: of their names, 2 before 10).
        count: number of photos; None for any.
        key: name of the argument, for messages.

    Raises:
        UserError: as for :func:`open_rows` and :func:`checked_rows`.
    """
    fix = "One row per photo, in the order of the photos: those of a folder by name, 2 before 10."
    if isinstance(descriptors, Path | str):
        path = Path(descriptors).expanduser()
        return checked_rows(open_rows(path, key), f"{key}={path}", count, fix)
    if not isinstance(descriptors, np.ndarray):
        raise ArgumentError(f"{key}={shown(descriptors)} must be an array or a file of one", fix)
    return checked_rows(descriptors, key, count, fix)
