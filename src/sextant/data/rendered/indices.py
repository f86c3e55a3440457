"""Normalising indices of items."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy import ndarray

#: One index, a slice, several indices, or a mask over all items.
Indices: TypeAlias = int | slice | Sequence[int] | ndarray


def chosen_items(indices: Indices, count: int) -> ndarray:
    """Indices as an array, each from 0 to ``count - 1``; of dimension 0 for a single one.

    Raises:
        IndexError: an index is out of range or not an integer.
    """
    if isinstance(indices, slice):
        return np.arange(count)[indices]
    chosen = np.asarray(indices)
    if chosen.size == 0:
        return np.zeros(chosen.shape, dtype=np.int64)
    if chosen.dtype == bool:
        return np.flatnonzero(chosen) if chosen.shape == (count,) else np.arange(count)[chosen]
    if not np.issubdtype(chosen.dtype, np.integer):
        raise IndexError(f"an index must be a whole number, got {chosen.dtype}")
    if chosen.min() < -count or chosen.max() >= count:
        raise IndexError(f"index {chosen.min()} to {chosen.max()} is out of range for {count} items")
    return np.where(chosen < 0, chosen + count, chosen)
