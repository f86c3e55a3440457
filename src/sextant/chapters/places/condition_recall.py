"""Recall@1 for each pair of conditions, and as a function of one appearance factor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Integer
from numpy import ndarray
from scipy.stats import norm

from sextant.evaluation.positives import Positives
from sextant.retrieval.flat_index import FlatIndex
from sextant.retrieval.nearest import Similarity


@dataclass(frozen=True)
class ConditionRecall:
    """Recall@1 of queries under one condition (row) among references under another (column).

    Attributes:
        conditions: their names, in the order of rows and columns.
        recall: over all queries of the row; nan where there is no query or reference. The only image of a condition
            counts as not found under it.
        queries: number of queries of each cell.
        unmatchable: number of queries of each cell without a positive under the references' condition.
    """

    conditions: tuple[str, ...]
    recall: Float[ndarray, "c c"]
    queries: Integer[ndarray, "c c"]
    unmatchable: Integer[ndarray, "c c"]

    @property
    def across(self) -> float:
        """Mean over all pairs of different conditions with queries and references; nan without such a pair."""
        different = ~np.eye(len(self.conditions), dtype=bool) & ~np.isnan(self.recall)
        return float(self.recall[different].mean()) if different.any() else float("nan")


def condition_recall(
    descriptors: Float32[ndarray, "n d"],
    condition: Integer[ndarray, "n"],
    positives: Positives,
    conditions: Sequence[str],
    similarity: Similarity = "cosine",
) -> ConditionRecall:
    """Recall@1 between all pairs of conditions; an image is never its own reference.

    Args:
        descriptors: of all images of all conditions.
        condition: of each image, an index of ``conditions``.
        positives: of all images among all images; whether an image is its own positive does not matter.
        conditions: names.
        similarity: ``cosine`` or ``euclidean``.

    Raises:
        ValueError: the numbers of images differ, or a condition has no name.

    >>> shown = Positives.from_lists([[0, 2], [1, 3], [0, 2], [1, 3]], 4)  # two places by day, the same two by night
    >>> looks = np.array([[1, 0], [0, 1], [1, 0.1], [1, 0.2]], np.float32)  # by night both look like the first by day
    >>> condition_recall(looks, np.array([0, 0, 1, 1]), shown, ["day", "night"]).recall
    array([[0. , 1. ],
           [0.5, 0. ]])
    """
    images, count = len(descriptors), len(conditions)
    if not len(condition) == len(positives) == positives.references == images:
        raise ValueError(
            f"need {images} conditions, and positives of {images} images among themselves; got {len(condition)}, "
            f"{len(positives)} and {positives.references}"
        )
    if images and not 0 <= condition.min() <= condition.max() < count:
        raise ValueError(f"conditions must be in [0, {count}), the indices of their names")
    members = [np.flatnonzero(condition == index) for index in range(count)]
    recall = np.full((count, count), np.nan)
    unmatchable = np.zeros((count, count), np.int64)
    for column, references in enumerate(members):
        if not len(references):
            unmatchable[:, column] = [len(queries) for queries in members]
            continue
        index = FlatIndex(descriptors[references], similarity)
        for row, queries in enumerate(members):
            if len(queries):
                nearest = _nearest_other(index, references, descriptors[queries], queries)
                recall[row, column] = np.mean(
                    [image in positives[int(i)] for i, image in zip(queries, nearest, strict=True)]
                )
                partners = (np.setdiff1d(positives[int(i)], [i]) for i in queries)
                unmatchable[row, column] = sum(not (condition[found] == column).any() for found in partners)
    sizes = np.array([len(queries) for queries in members])
    return ConditionRecall(tuple(conditions), recall, np.repeat(sizes[:, None], count, axis=1), unmatchable)


@dataclass(frozen=True)
class FactorRecall:
    """Recall@1 of one method at each value of an appearance factor.

    Attributes:
        values: of the factor, increasing.
        recall: over all queries at that value.
        low, high: 95 % interval of E. B. Wilson, JASA 1927, which assumes independent queries; neighbouring frames are
            not independent, so it is too narrow for them.
        queries: number of queries at each value.
    """

    values: Float[ndarray, "v"]
    recall: Float[ndarray, "v"]
    low: Float[ndarray, "v"]
    high: Float[ndarray, "v"]
    queries: Integer[ndarray, "v"]


def factor_recall(hit: Bool[ndarray, "m"], factor: Float[ndarray, "m"], level: float = 0.95) -> FactorRecall:
    """Group queries by their images' value of the factor.

    Args:
        hit: whether the nearest reference of a query is a positive.
        factor: its value for the query's image, such as the sun's elevation in degrees.
        level: of the intervals, in (0, 1).

    Raises:
        ValueError: the lengths differ, there is no query, a value is not finite, or the level is not in (0, 1).

    >>> hit, sun_deg = np.array([True, True, True, False]), np.array([30.0, 30.0, 5.0, 5.0])
    >>> found = factor_recall(hit, sun_deg)
    >>> found.values, found.recall
    (array([ 5., 30.]), array([0.5, 1. ]))
    """
    if len(hit) != len(factor) or not len(hit) or not np.isfinite(factor).all() or not 0 < level < 1:
        raise ValueError(f"need hits and finite factors of some queries, 0 < level < 1; got {len(hit)}, {len(factor)}")
    values, group, queries = np.unique(factor, return_inverse=True, return_counts=True)
    share = np.bincount(group, weights=hit) / queries
    z = float(norm.ppf((1 + level) / 2))
    centre = (share + z**2 / (2 * queries)) / (1 + z**2 / queries)
    half = z / (1 + z**2 / queries) * np.sqrt(share * (1 - share) / queries + (z / (2 * queries)) ** 2)
    low, high = np.maximum(centre - half, 0), np.minimum(centre + half, 1)
    return FactorRecall(values.astype(float), share, low, high, queries)


def _nearest_other(index: FlatIndex, references: ndarray, descriptors: ndarray, queries: ndarray) -> list[int]:
    """The image nearest to each query that is not the query itself; -1 if it is the only one."""
    found = references[index.search(descriptors, min(2, len(index))).indices]
    return [next((int(i) for i in row if i != query), -1) for row, query in zip(found, queries, strict=True)]
