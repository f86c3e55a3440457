"""Some images of an array, read only on demand."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int64, UInt8
from numpy import ndarray


class ImageRows:
    """Some images of an array that may be memory-mapped: only those requested are read.

    Args:
        images: ``(n, h, w, c)`` bytes.
        rows: which of them, in order; None for all.
    """

    def __init__(self, images: UInt8[ndarray, "n h w c"], rows: Int64[ndarray, "m"] | None = None):
        self._images = np.asarray(images)  # a plain view of a memory map is quick to index
        self._rows = np.arange(len(images)) if rows is None else np.asarray(rows, np.int64)

    @property
    def altered(self) -> str:
        """Identifies what was done to the images since they were stored; empty if nothing was."""
        return ""

    @property
    def store(self) -> UInt8[ndarray, "n h w c"]:
        """The array that the images are rows of."""
        return self._images

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def rows(self) -> Int64[ndarray, "m"]:
        """Indices of these images in the array."""
        return self._rows

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Number of images, height, width, channels."""
        return (len(self), *self._images.shape[1:])

    def __getitem__(self, indices: int | slice | Sequence[int] | ndarray) -> UInt8[ndarray, "*k h w c"]:
        """Images by index, copied into memory."""
        rows = self._rows[indices]
        return self._images[rows] if isinstance(rows, ndarray) else self._images[rows].copy()

    def __array__(self, dtype: object = None, copy: bool | None = None) -> ndarray:
        return np.asarray(self[:], dtype)  # type: ignore[call-overload,no-any-return]

    def select(self, indices: ndarray) -> "ImageRows":
        """Some of these images, still on disk."""
        return ImageRows(self._images, self._rows[indices])
