"""Neighbours among references that are split over several processes or hosts."""

from collections.abc import Sequence

import numpy as np

from sextant.retrieval.nearest import Neighbours, Similarity


def joined_neighbours(
    parts: Sequence[Neighbours], sizes: Sequence[int], k: int, similarity: Similarity = "cosine"
) -> Neighbours:
    """The k most similar references of each query, from those that each part found among its own.

    If each part was asked for k, or for all that it has, the result is that of one index of all references in the order
    of the parts, to the bit: the similarity of two descriptors depends on nothing else.

    Args:
        parts: neighbours of the same queries in each part.
        sizes: number of references in each part.
        k: number of neighbours, at most as many as the parts have found.
        similarity: similarity of the index.

    Raises:
        ValueError: the parts have found fewer than k neighbours, or there are not as many sizes as parts.

    Example:
        >>> a, b = (Neighbours(np.array([[v]]), np.array([[0]])) for v in (0.2, 0.9))
        >>> joined_neighbours([a, b], [5, 3], 1).indices.tolist()
        [[5]]
    """
    if len(parts) != len(sizes):
        raise ValueError(f"{len(parts)} parts, but {len(sizes)} sizes")
    first = np.cumsum([0, *sizes[:-1]])
    values = np.concatenate([part.values for part in parts], axis=1)
    indices = np.concatenate([part.indices + start for part, start in zip(parts, first, strict=True)], axis=1)
    if not 1 <= k <= values.shape[1]:
        raise ValueError(f"k={k}, but the parts have found {values.shape[1]} neighbours")
    order = np.lexsort((indices, -values if similarity == "cosine" else values), axis=1)[:, :k]
    return Neighbours(np.take_along_axis(values, order, 1), np.take_along_axis(indices, order, 1))
