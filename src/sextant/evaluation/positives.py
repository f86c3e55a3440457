"""The references that show the place of each query: the ground truth of place recognition, stored sparsely.

Metric positions, frame numbers of aligned traverses and published index lists are all converted to this form, so that
every metric is defined once. A query may have no positive: metrics count such queries and state how they treat them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from jaxtyping import Bool, Int64, Integer
from numpy import ndarray


@dataclass(frozen=True)
class Positives:
    """Positive references of m queries among n references, as compressed sparse rows.

    Build it with ``from_mask``, ``from_lists``, ``from_sparse`` or ``within_frames``.

    Attributes:
        starts: the positives of query i are ``indices[starts[i]:starts[i + 1]]``.
        indices: of references, ascending and distinct within a query.
        references: n.

    Raises:
        ValueError: the starts or the indices are not of this form.

    Example:
        >>> shown = Positives.from_lists([[0, 1], []], references=3)  # the second query has none
        >>> shown.hits(np.array([[2, 1], [0, 2]]))  # two neighbours of each
        array([[False,  True],
               [False, False]])
        >>> shown.unmatchable
        1
    """

    starts: Int64[ndarray, "m1"]
    indices: Int64[ndarray, "p"]
    references: int

    def __post_init__(self) -> None:
        if len(self.starts) < 1 or self.starts[0] != 0 or self.starts[-1] != len(self.indices):
            raise ValueError("starts must begin with 0 and end with the number of indices")
        if (np.diff(self.starts) < 0).any():
            raise ValueError("starts must not decrease")
        if len(self.indices) and not 0 <= self.indices.min() <= self.indices.max() < self.references:
            raise ValueError(f"positives must be in [0, {self.references}), the indices of the references")
        if (np.diff(self._keys) <= 0).any():
            raise ValueError("the positives of a query must be ascending and distinct")

    @classmethod
    def from_mask(cls, mask: Bool[ndarray, "m n"]) -> Self:
        """From a matrix that is true where the reference (column) is a positive of the query (row)."""
        query, reference = np.nonzero(mask)
        return cls(_starts(np.bincount(query, minlength=len(mask))), reference.astype(np.int64), mask.shape[1])

    @classmethod
    def from_lists(cls, lists: Sequence[Sequence[int] | Integer[ndarray, "p"]], references: int) -> Self:
        """From the positive references of every query, in any order; repeated ones count once.

        Raises:
            ValueError: an index is not in [0, references).
        """
        rows = [np.unique(np.asarray(row, np.int64)) for row in lists]
        counts = np.array([len(row) for row in rows], np.int64)
        return cls(_starts(counts), np.concatenate([np.empty(0, np.int64), *rows]), references)

    @classmethod
    def from_sparse(cls, matrix: Any) -> Self:
        """From a SciPy sparse matrix or array (m, n); its non-zero entries are positives."""
        rows = matrix.tocsr(copy=True)
        rows.sum_duplicates()
        rows.eliminate_zeros()
        return cls(rows.indptr.astype(np.int64), rows.indices.astype(np.int64), int(rows.shape[1]))

    @classmethod
    def within_frames(cls, query: Integer[ndarray, "m"], reference: Integer[ndarray, "n"], tolerance: int) -> Self:
        """All references whose frame number differs by at most ``tolerance``, for traverses with aligned frames.

        Raises:
            ValueError: the tolerance is negative.

        >>> frames = np.arange(4)
        >>> Positives.within_frames(frames, frames, tolerance=1).counts  # at the ends there is only one neighbour
        array([2, 3, 3, 2])
        """
        if tolerance < 0:
            raise ValueError(f"tolerance={tolerance} must be at least 0 frames")
        order = np.argsort(reference, kind="stable")
        low = np.searchsorted(reference[order], query - tolerance, side="left")
        high = np.searchsorted(reference[order], query + tolerance, side="right")
        return cls.from_lists([order[a:b] for a, b in zip(low, high, strict=True)], len(reference))

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, query: int) -> Int64[ndarray, "p"]:
        """Positive references of one query, in ascending order."""
        if not 0 <= query < len(self):
            raise IndexError(f"query {query} of {len(self)}")
        return self.indices[self.starts[query] : self.starts[query + 1]]

    @property
    def counts(self) -> Int64[ndarray, "m"]:
        """Number of positives of every query."""
        return np.diff(self.starts)

    @property
    def matchable(self) -> Bool[ndarray, "m"]:
        """Which queries have a positive."""
        return np.asarray(self.counts > 0)

    @property
    def unmatchable(self) -> int:
        """Number of queries without a positive."""
        return int((~self.matchable).sum())

    def hits(self, neighbours: Integer[ndarray, "m k"]) -> Bool[ndarray, "m k"]:
        """Whether each of the k references found for a query is one of its positives.

        Raises:
            ValueError: there is not one row of neighbours for each query, or one is not an index of a reference.
        """
        if neighbours.ndim != 2 or len(neighbours) != len(self):
            raise ValueError(f"need neighbours of {len(self)} queries, one per row; got {neighbours.shape}")
        if neighbours.size and not 0 <= neighbours.min() <= neighbours.max() < self.references:
            raise ValueError(f"neighbours must be in [0, {self.references}), the indices of the references")
        wanted = np.arange(len(self))[:, None] * self.references + neighbours
        keys = self._keys
        if not len(keys):
            return np.zeros(neighbours.shape, bool)
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        return np.asarray(keys[place] == wanted)

    @property
    def _keys(self) -> Int64[ndarray, "p"]:
        """Each pair of query and reference as one number, in increasing order."""
        return np.asarray(np.repeat(np.arange(len(self)), self.counts) * self.references + self.indices)


def _starts(counts: ndarray) -> Int64[ndarray, "m1"]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
