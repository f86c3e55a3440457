"""Neighbours among references of which several processes, or hosts, hold a part each."""

from collections.abc import Sequence

import numpy as np

from sextant.retrieval.nearest import Neighbours, Similarity


def joined_neighbours(
    parts: Sequence[Neighbours], sizes: Sequence[int], k: int, similarity: Similarity = "cosine"
) -> Neighbours:
    """The k most similar references of each query, from what each part found among its own.

    They are those, to the bit, of one index of all references in the order of the parts, if each part was asked for k,
    or for all that it has: how similar two descriptors are depends on nothing else.

    Args:
        parts: neighbours of the same queries in each part.
        sizes: references of each part.
        k: neighbours, at most the references that the parts have found.
        similarity: of the index.

    Raises:
        ValueError: there are not so many neighbours, or not as many sizes as parts.

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
