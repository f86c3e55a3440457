r"""Pairs of nearby places, in memory that grows with the number of such pairs.

Distances are :math:`d_{ij} = \lVert p_i - q_j \rVert`, compared in float64 exactly as written; the k-d tree only
proposes candidates. Source of the tree: J. L. Bentley, "Multidimensional binary search trees used for associative
searching", CACM 18(9), 1975.
"""

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

#: queries looked up at a time, and pairs that may be proposed for them, of 24 bytes each
CHUNK, PROPOSED = 512, 2_000_000


def within_distance(
    queries: Float64[ndarray, "q 2"], references: Float64[ndarray, "r 2"], distance: float, *, strict: bool = False
) -> csr_array:
    """Pairs of positions at most ``distance`` apart, as a boolean matrix ``(q, r)``.

    Args:
        queries: positions.
        references: positions.
        distance: in the unit of the positions.
        strict: less than ``distance`` instead of at most.

    Raises:
        ValueError: a position is not finite.
    """
    if not (np.isfinite(queries).all() and np.isfinite(references).all()):
        raise ValueError("positions must be finite")
    if not len(queries) or not len(references):
        return csr_array((len(queries), len(references)), dtype=bool)
    tree = cKDTree(references)
    reach = distance * (1 + 1e-9) + 1e-9
    columns, counts = [], []
    chunk = max(1, min(CHUNK, PROPOSED // len(references)))
    for start in range(0, len(queries), chunk):
        part = queries[start : start + chunk]
        row, column = _proposed(tree, part, reach)
        apart = np.hypot(*(part[row] - references[column]).T)
        near = apart < distance if strict else apart <= distance
        columns.append(column[near].astype(np.int32))
        counts.append(np.bincount(row[near], minlength=len(part)))
    return _matrix(np.concatenate(columns), np.concatenate(counts), len(references))


def _proposed(tree: cKDTree, part: Float64[ndarray, "k 2"], reach: float) -> tuple[ndarray, ndarray]:
    """Pairs that may be near, in row order: those proposed by the tree, or all pairs if these would be many."""
    if 20 * tree.query_ball_point(part, reach, return_length=True).sum() > len(part) * tree.n:
        row, column = np.indices((len(part), tree.n)).reshape(2, -1)
        return row, column
    found = cKDTree(part).sparse_distance_matrix(tree, reach, output_type="ndarray")
    order = np.lexsort([found["j"], found["i"]])
    return found["i"][order], found["j"][order]


def within_frames(
    queries: Int64[ndarray, "q"], references: Int64[ndarray, "r"], distance: float, *, strict: bool = False
) -> csr_array:
    """Pairs of frame numbers at most ``distance`` apart, or less than that if ``strict``; boolean, ``(q, r)``."""
    order = np.argsort(references, kind="stable")
    ordered = references[order]
    begin = np.searchsorted(ordered, queries - distance, "right" if strict else "left")
    end = np.searchsorted(ordered, queries + distance, "left" if strict else "right")
    counts = np.maximum(end - begin, 0)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    matrix = _matrix(order[np.repeat(begin, counts) + offset].astype(np.int32), counts, len(references))
    matrix.sort_indices()
    return matrix


def keep_pairs(matrix: csr_array, keep: ndarray) -> csr_array:
    """The pairs of a matrix for which ``keep``, in storage order, is true."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return _matrix(matrix.indices[keep], np.bincount(rows[keep], minlength=matrix.shape[0]), matrix.shape[1])


def pairs_of(matrix: csr_array, row: int) -> Int64[ndarray, "k"]:
    """Columns of the pairs of one row."""
    return np.asarray(matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]], np.int64)


def heading_difference_deg(a: Float64[ndarray, "n"], b: Float64[ndarray, "n"]) -> Float64[ndarray, "n"]:
    """Angle between headings in degrees, 0 to 180, modulo full turns."""
    return np.asarray(np.abs((a - b + 180) % 360 - 180))


def _matrix(columns: ndarray, counts: ndarray, width: int) -> csr_array:
    starts = np.concatenate([[0], np.cumsum(counts)])
    if len(columns) < 2**31:  # SciPy keeps indices in four bytes only if both arrays are
        starts = starts.astype(np.int32)
    return csr_array((np.ones(len(columns), bool), columns, starts), shape=(len(counts), width))
