"""Exact nearest neighbours among descriptors, and recall on traverses whose frames are aligned."""

from typing import Literal

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

from sextant.baselines.descriptor import unit_norm

Similarity = Literal["cosine", "euclidean"]

#: Entries of the block of similarities that is held at a time: 64 MiB.
BLOCK = 2**24


def nearest_neighbours(
    reference: Float32[ndarray, "n d"],
    query: Float32[ndarray, "m d"],
    k: int = 1,
    similarity: Similarity = "cosine",
) -> Int64[ndarray, "m k"]:
    """Indices of the k most similar reference descriptors, best first; of equal ones the lower index first.

    Blocks of queries are compared by one matrix product, in float32. Whatever its rounding could have placed among the
    best k is compared again in float64, so that the result depends neither on the block nor on the BLAS.

    Args:
        reference, query: one descriptor a row.
        k: neighbours, in [1, n].
        similarity: ``cosine`` (a row of zeros is at 0 to everything) or ``euclidean``.

    Raises:
        ValueError: k is out of range, the dimensions differ, or a descriptor is not finite.
    """
    if reference.ndim != 2 or query.ndim != 2 or reference.shape[1] != query.shape[1]:
        raise ValueError(f"need rows of one length; got {reference.shape} and {query.shape}")
    if not 1 <= k <= len(reference):
        raise ValueError(f"k={k} must be in [1, {len(reference)}], the number of reference descriptors")
    if not (np.isfinite(reference).all() and np.isfinite(query).all()):
        raise ValueError("a descriptor is not finite")
    if similarity == "cosine":
        reference, query = unit_norm(reference), unit_norm(query)
    half = 0.5 * np.einsum("nd,nd->n", reference, reference) if similarity == "euclidean" else np.float32(0)
    # rounding of a product of d terms is at most (d + 2) eps ||q|| ||r||, and the like for ||r||²
    longest = float(np.linalg.norm(reference, axis=1).max())
    rounding = (reference.shape[1] + 2) * float(np.finfo(np.float32).eps) * longest
    lengths = np.linalg.norm(query, axis=1) + (longest if similarity == "euclidean" else 0)
    found = np.empty((len(query), k), np.int64)
    rows = max(1, BLOCK // len(reference))
    for start in range(0, len(query), rows):
        scores = query[start : start + rows] @ reference.T - half  # (rows, n)
        worst = np.partition(scores, -k, axis=1)[:, -k]
        for row, (score, kth) in enumerate(zip(scores, worst, strict=True), start):
            close = np.flatnonzero(score >= kth - 2 * rounding * lengths[row])
            settled = len(close) == 1 or lengths[row] == 0
            exact = score[close] if settled else _exact(reference, query[row], close, similarity)
            found[row] = close[np.argsort(-exact, kind="stable")[:k]]
    return found


def recall_name(tolerance: int, k: int = 1) -> str:
    """The name of a recall with its protocol: ``R@1_pm1f`` counts a match within ±1 frame, over all queries."""
    return f"R@{k}_pm{tolerance}f"


def recall_within_frames(
    reference: Float32[ndarray, "n d"],
    query: Float32[ndarray, "m d"],
    tolerance: int = 1,
    similarity: Similarity = "cosine",
) -> float:
    """Recall@1 on aligned traverses, where query i and reference i show one place; ``recall_name`` is its name.

    ``R@1 = |{i : |nn(i) - i| <= tolerance}| / m``, over all queries. Chance is ``(2 tolerance + 1) / n``.

    Args:
        reference, query: one descriptor a row, in the order of the frames.
        tolerance: in frames, at least 0.
        similarity: ``cosine`` or ``euclidean``.

    Raises:
        ValueError: the traverses differ in length, or what ``nearest_neighbours`` raises.
    """
    if len(reference) != len(query):
        raise ValueError(f"aligned traverses have as many frames each; got {len(reference)} and {len(query)}")
    nearest = nearest_neighbours(reference, query, 1, similarity)[:, 0]
    return float((np.abs(nearest - np.arange(len(query))) <= tolerance).mean())


def _exact(
    reference: Float32[ndarray, "n d"], query: Float32[ndarray, "d"], close: Int64[ndarray, "c"], kind: Similarity
) -> ndarray:
    """Similarities in float64, each summed in the same order."""
    chosen = reference[close].astype(np.float64)
    if kind == "cosine":
        return np.asarray((chosen * query).sum(axis=1))
    return np.asarray(-((chosen - query) ** 2).sum(axis=1))
