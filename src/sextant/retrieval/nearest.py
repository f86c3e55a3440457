"""Exact nearest neighbours among descriptors, independent of block size, number of threads and BLAS.

Exact is the comparison of what is stored: rows that were scaled to norm one for cosine similarity are rounded to
float32, which may reorder descriptors that differ by no more, as with a large common mean.

A matrix product in float32 gives all scores of a block of queries, up to rounding: for d terms each differs from the
true value by at most ``ε = (d + 2) u ||q|| ||r||``, with u the machine epsilon. So the k best are among the references
whose score is within ``2 ε`` of the k-th best score. Only these few are compared again, in float64 and term by term in
the same order, and ties are broken by index.

The k-th best score is not sought among all n: with the references divided into groups, k group maxima are k scores, so
the k-th best maximum bounds it from below. That takes one pass of maxima and one of comparisons.

Source of the bound: N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2002, section 3.1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

from sextant.baselines.place_descriptors import unit_norm

Similarity = Literal["cosine", "euclidean"]

#: Entries of the block of scores that is held at a time: 64 MiB.
BLOCK = 2**24
#: Groups of references whose best score bounds the k-th best; eight for each neighbour if that is more.
GROUPS = 2048
#: Entries of float64 that are held while close references are compared again: 32 MiB.
RECOMPARED = 2**22


class Neighbours(NamedTuple):
    """The k most similar references of each of m queries, best first; ties go to the lower index.

    Attributes:
        values: cosine similarities, descending, or Euclidean distances, ascending.
        indices: indices of the references.
    """

    values: Float32[ndarray, "m k"]
    indices: Int64[ndarray, "m k"]


@dataclass(frozen=True)
class PreparedReferences:
    """References with everything that does not depend on the query.

    Attributes:
        rows: descriptors; of norm one (or zero) for cosine similarity.
        similarity: by which descriptors are compared.
        half: ``||r||² / 2`` of every row for Euclidean distance, else 0.
        longest: the largest norm of a row.
    """

    rows: Float32[ndarray, "n d"]
    similarity: Similarity
    half: ndarray
    longest: float


def prepare_references(
    descriptors: Float32[ndarray, "n d"], similarity: Similarity = "cosine", *, unit: bool = False
) -> PreparedReferences:
    """Check the references and compute their norms, once.

    Args:
        descriptors: one per row, in float32.
        similarity: ``cosine`` (a row of zeros has similarity 0 to everything) or ``euclidean``.
        unit: the rows have norm one already and are taken as they are.

    Raises:
        ValueError: there is no descriptor, one is not finite or, for Euclidean distance, too large for float32, they
            are not float32 or the similarity is unknown.
    """
    if similarity not in ("cosine", "euclidean"):
        raise ValueError(f"similarity={similarity!r} must be cosine or euclidean")
    _check(descriptors, "reference")
    if descriptors.size == 0:
        raise ValueError(f"need at least one reference descriptor of at least one value; got {descriptors.shape}")
    rows = unit_norm(descriptors) if similarity == "cosine" and not unit else descriptors
    rows = np.ascontiguousarray(rows)
    squared = np.einsum("nd,nd->n", rows, rows)
    if not np.isfinite(squared).all():
        raise ValueError("a reference descriptor is too large for float32: its squared norm is infinite")
    half = 0.5 * squared if similarity == "euclidean" else np.zeros((), np.float32)
    return PreparedReferences(rows, similarity, half, float(np.sqrt(squared.max())))


def nearest_neighbours(
    reference: Float32[ndarray, "n d"],
    query: Float32[ndarray, "m d"],
    k: int = 1,
    similarity: Similarity = "cosine",
) -> Int64[ndarray, "m k"]:
    """Indices of the k most similar reference descriptors, best first; ties go to the lower index.

    >>> references = np.eye(3, dtype=np.float32)
    >>> nearest_neighbours(references, np.array([[1.0, 0.5, 0.0]], np.float32), k=2)
    array([[0, 1]])

    Args:
        reference, query: one descriptor per row.
        k: number of neighbours, in [1, n].
        similarity: ``cosine`` (a row of zeros has similarity 0 to everything) or ``euclidean``.

    Raises:
        ValueError: k is out of range, the dimensions differ, or a descriptor is not finite or, for Euclidean distance,
            too large for float32.
    """
    return search_prepared(prepare_references(reference, similarity), query, k).indices


def search_prepared(references: PreparedReferences, query: Float32[ndarray, "m d"], k: int = 1) -> Neighbours:
    """The k most similar references for every query; see the module.

    Memory besides the result: ``BLOCK`` scores, or one query's scores if there are more references than that.

    Raises:
        ValueError: k is out of range, the dimensions differ, or a query is not finite or, for Euclidean distance, too
            large for float32.
    """
    rows, euclidean = references.rows, references.similarity == "euclidean"
    count, dimension = rows.shape
    if query.ndim != 2 or query.shape[1] != dimension:
        raise ValueError(f"need rows of one length; got {rows.shape} and {query.shape}")
    if not 1 <= k <= count:
        raise ValueError(f"k={k} must be in [1, {count}], the number of reference descriptors")
    _check(query, "query")
    if not euclidean:
        query = unit_norm(query)
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(query, axis=1).astype(np.float64)
    limits = np.finfo(np.float32)
    longest = max(references.longest, float(limits.tiny) ** 0.5)  # squares of smaller norms lose digits
    if euclidean and ((lengths + longest) ** 2 > float(limits.max) / 2).any():
        raise ValueError("descriptors are too large for float32: squared distances of a query may be infinite")
    rounding = (dimension + 2) * float(limits.eps) * longest
    slack = 2 * rounding * (lengths + longest if euclidean else lengths)
    indices, values = np.empty((len(query), k), np.int64), np.empty((len(query), k), np.float32)
    at_a_time = max(1, BLOCK // count)
    for start in range(0, len(query), at_a_time):
        block = query[start : start + at_a_time]
        # a vector for one query: a matrix-vector product is bound by memory alone
        scores = (rows @ block[0])[None] if len(block) == 1 else block @ rows.T
        if euclidean:
            scores -= references.half
        for row, score in enumerate(scores, start):
            close = _close(score, k, float(slack[row]))
            exact = _exact(rows, query[row], close, euclidean)
            order = np.argsort(-exact, kind="stable")[:k]
            indices[row], values[row] = close[order], exact[order]
    return Neighbours(np.sqrt(-np.minimum(values, 0)) if euclidean else values, indices)


def _close(score: Float32[ndarray, "n"], k: int, slack: float) -> Int64[ndarray, "c"]:
    """Ascending indices of all scores within ``slack`` of the k-th best."""
    groups = max(GROUPS, 8 * k)
    if len(score) < 2 * groups:
        return np.flatnonzero(score >= np.partition(score, -k)[-k] - slack)
    # every groups-th score is in one group: consecutive frames are similar and should not share one
    best = score[: len(score) // groups * groups].reshape(-1, groups).max(axis=0)
    close = np.flatnonzero(score >= np.partition(best, -k)[-k] - slack)
    chosen = score[close]
    return np.asarray(close[chosen >= np.partition(chosen, -k)[-k] - slack])


def _exact(
    rows: Float32[ndarray, "n d"], query: Float32[ndarray, "d"], close: Int64[ndarray, "c"], euclidean: bool
) -> ndarray:
    """Cosine similarities or negative squared distances in float64, each summed in the same order."""
    wide = query.astype(np.float64)
    at_a_time = max(1, RECOMPARED // max(1, rows.shape[1]))
    parts = []
    for start in range(0, len(close), at_a_time):
        chosen = rows[close[start : start + at_a_time]].astype(np.float64)
        parts.append(-((chosen - wide) ** 2).sum(axis=1) if euclidean else (chosen * wide).sum(axis=1))
    return np.concatenate(parts)


def _check(descriptors: ndarray, what: str) -> None:
    if descriptors.ndim != 2 or descriptors.dtype != np.float32:
        raise ValueError(f"need {what} descriptors (n, d) of float32; got {descriptors.dtype} {descriptors.shape}")
    if not np.isfinite(descriptors).all():
        raise ValueError(f"a {what} descriptor is not finite")


def joined_neighbours(
    parts: Sequence[Neighbours], sizes: Sequence[int], k: int, similarity: Similarity = "cosine"
) -> Neighbours:
    """The k most similar references of each query, from those that each part found among its own.

    If each part was searched for k neighbours, or for all of its references, the result is that of one index of all
    references in the order of the parts, bit for bit, but for the order of references whose similarities are equal in
    float32: one index compares these in float64.

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
