"""Metrics of place recognition: recall@1 by condition and by appearance factor, precision-recall curves, and the
expected recall of a descriptor that confuses only identical images."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64, Integer
from numpy import ndarray
from scipy.stats import norm

from sextant.evaluation.positives import Positives
from sextant.evaluation.retrieval import RetrievalProtocol
from sextant.retrieval.flat_index import FlatIndex
from sextant.retrieval.nearest import Similarity
from sextant.tables import counted


@dataclass(frozen=True)
class PrecisionRecall:
    r"""A precision-recall curve from recall 0 on, as the threshold decreases.

    *Single best match*: each query proposes its most similar reference, which is accepted if its similarity is at least
    the threshold. With TP right and FP wrong matches among those accepted, and M queries that have a positive,

    .. math:: P = \frac{TP}{TP + FP}, \qquad R = \frac{TP}{M} .

    The best match of a query without a positive is always wrong. *All pairs*: every pair of query and reference is
    accepted or rejected on its own, and M is the number of positive pairs.

    Published implementations differ; the choices made here are:

    - Recall is over the queries that have a positive, so that a method that finds few never reaches 1. A
      general-purpose curve over the best matches divides by the number of right ones instead and always ends at 1,
      which is optimistic.
    - Every distinct similarity is a threshold, and equal ones are accepted together; a fixed grid of 100 thresholds
      misses those at which precision is still 1.
    - The curve starts at recall 0 with precision 1, where nothing is accepted.
    - ``auc`` is the area by the trapezoid rule over that curve (S. Schubert et al., "Visual Place Recognition: A
      Tutorial", 2023); ``average_precision`` is :math:`\sum_t (R_t - R_{t-1}) P_t`, which does not interpolate. They
      differ.
    - Recall at precision p is the largest recall of all thresholds with precision at least p, even if precision was
      lower in between. The interpolated precision :math:`\max_{r' \ge r} P(r')` gives the same value.

    Attributes:
        precision, recall: at each threshold; the first is precision 1 at recall 0.
        thresholds: the first is infinite.
        positives: M, the denominator of recall.
        unmatchable: queries without a positive, whose matches count as wrong.

    Example:
        >>> curve = precision_recall(np.array([0.9, 0.8, 0.7]), np.array([True, False, True]), positives=2)
        >>> curve.recall_at_precision(1), round(curve.average_precision, 2)  # 1/2, and (1 + 2/3) / 2
        (0.5, 0.83)
    """

    precision: Float[ndarray, "t"]
    recall: Float[ndarray, "t"]
    thresholds: Float[ndarray, "t"]
    positives: int
    unmatchable: int = 0

    @property
    def auc(self) -> float:
        """Area by the trapezoid rule; nan without a positive."""
        return float(np.trapezoid(self.precision, self.recall)) if self.positives else float("nan")

    @property
    def average_precision(self) -> float:
        """Area by the sum of rectangles; nan without a positive."""
        return float((np.diff(self.recall) * self.precision[1:]).sum()) if self.positives else float("nan")

    def recall_at_precision(self, precision: float) -> float:
        """The largest recall with at least this precision; 0 if there is none, nan without a positive.

        Raises:
            ValueError: the precision is not in (0, 1].
        """
        if not 0 < precision <= 1:
            raise ValueError(f"precision={precision} must be in (0, 1]")
        # 99 of 100 is 0.99 up to rounding
        return float(self.recall[self.precision >= precision - 1e-12].max()) if self.positives else float("nan")

    def named(self, protocol: RetrievalProtocol) -> dict[str, float]:
        """The figures under their full names."""
        figures = {
            "pr_auc": self.auc,
            "average_precision": self.average_precision,
            "R@100P": self.recall_at_precision(1),
            "R@99P": self.recall_at_precision(0.99),
        }
        return {protocol.name(name): value for name, value in figures.items()}


def best_match_curve(
    neighbours: Integer[ndarray, "m k"], similarities: Float[ndarray, "m k"], positives: Positives
) -> PrecisionRecall:
    """The curve of single best matches; only the first column of the neighbours is used.

    Args:
        neighbours: references found for every query, most similar first.
        similarities: of the neighbours; negate distances.
        positives: of the same queries.

    Raises:
        ValueError: a similarity is not a number, or the neighbours do not match the positives.

    >>> shown = Positives.from_lists([[0], [1], []], references=2)  # the place of the third query is not in the map
    >>> curve = best_match_curve(np.array([[0], [1], [1]]), np.array([[0.9], [0.6], [0.7]]), shown)
    >>> curve.recall_at_precision(1)  # its wrong match is more similar than the second right one
    0.5
    """
    if neighbours.shape != similarities.shape:
        raise ValueError(f"need a similarity for each neighbour; got {similarities.shape} for {neighbours.shape}")
    right = positives.hits(neighbours[:, :1])[:, 0]
    matchable = len(positives) - positives.unmatchable
    return precision_recall(similarities[:, 0], right, matchable, positives.unmatchable)


def precision_recall(
    similarities: Float[ndarray, "s"], right: Bool[ndarray, "s"], positives: int, unmatchable: int = 0
) -> PrecisionRecall:
    """The curve of candidates from their similarities; ``positives`` is M, the denominator of recall.

    Raises:
        ValueError: a similarity is nan, or more candidates are right than there are positives.

    >>> curve = precision_recall(np.array([0.9, 0.8, 0.7]), np.array([True, False, True]), positives=2)
    >>> curve.precision.round(2), curve.recall
    (array([1.  , 1.  , 0.5 , 0.67]), array([0. , 0.5, 0.5, 1. ]))
    """
    if similarities.shape != right.shape or similarities.ndim != 1:
        raise ValueError(f"need one similarity for each candidate; got {similarities.shape} and {right.shape}")
    if np.isnan(similarities).any():
        raise ValueError("a similarity is not a number")
    if right.sum() > positives:
        raise ValueError(f"{int(right.sum())} candidates are right, but there are only {positives} positives")
    order = np.argsort(-similarities, kind="stable")
    falling = similarities[order]
    last = np.flatnonzero(np.append(falling[1:] != falling[:-1], len(falling) > 0))  # last candidate of each similarity
    true = right[order].cumsum()[last]
    precision = true / (last + 1)
    recall = true / positives if positives else np.zeros(len(last))
    return PrecisionRecall(
        np.concatenate([[1.0], precision]),
        np.concatenate([[0.0], recall]),
        np.concatenate([[np.inf], falling[last].astype(float)]),
        positives,
        unmatchable,
    )


def picture_runs(like_before: Bool[ndarray, "n"]) -> Int64[ndarray, "n"]:
    r"""Run number of each frame, from 0, where ``like_before`` marks frames with the same image as the previous one.

    Consecutive frames with the same picture form a *run*. A descriptor is a function of the picture: all queries of a
    run get the same answer, and the references of a run are returned with equal probability or not at all. The best
    such descriptor distinguishes all different images and answers each run of queries Q with the run of references R
    that is right most often. Its expected recall@1 is

    .. math:: \frac{1}{m} \sum_Q \max_R \sum_{i \in Q} \frac{|P_i \cap R|}{|R|},

    where :math:`P_i` are the positives of query i and m is the number of queries. This is the expectation for a perfect
    descriptor, not a bound for every method: images of a run differ by noise, and sequences hold more information than
    single images.

    The first frame always starts a run.

    >>> picture_runs(np.array([False, False, True, True, False]))
    array([0, 1, 1, 1, 2])
    """
    runs = np.cumsum(~np.asarray(like_before, bool))
    return np.asarray(runs - runs[0] if len(runs) else runs, np.int64)


def standstill(like_before: Bool[ndarray, "n"]) -> Bool[ndarray, "n"]:
    """Frames with the same image as the previous or next frame: all members of runs of two or more.

    >>> standstill(np.array([False, False, True, True, False]))
    array([False,  True,  True,  True, False])
    """
    runs = picture_runs(like_before)
    return np.asarray(np.bincount(runs)[runs] > 1) if len(runs) else np.zeros(0, bool)


def single_image_ceiling(
    positives: Positives, query_run: Int64[ndarray, "m"], reference_run: Int64[ndarray, "n"]
) -> float:
    """Expected recall@1, over all queries, of a descriptor that confuses only identical images; nan without queries.

    Args:
        positives: of m queries among n references.
        query_run, reference_run: the run of each image, see :func:`picture_runs`.

    Raises:
        ValueError: the lengths differ.

    >>> frames, run = np.arange(4), picture_runs(np.array([False, False, True, False]))  # frames 1 and 2 are alike
    >>> single_image_ceiling(Positives.within_frames(frames, frames, 0), run, run)  # one of the two is answered right
    0.75
    """
    if (len(query_run), len(reference_run)) != (len(positives), positives.references):
        raise ValueError(
            f"need runs of {counted(len(positives), 'query', 'queries')} and {positives.references} references; got "
            f"{len(query_run)} and {len(reference_run)}"
        )
    if not len(positives):
        return float("nan")
    runs, reference = np.unique(reference_run, return_inverse=True)
    share = 1 / np.bincount(reference)
    queries, query = np.unique(query_run, return_inverse=True)
    pair_query = np.repeat(query, positives.counts)
    pair_reference = reference[positives.indices]
    cells, cell = np.unique(pair_query * len(runs) + pair_reference, return_inverse=True)
    right = np.bincount(cell, weights=share[pair_reference], minlength=len(cells))
    best = np.zeros(len(queries))
    np.maximum.at(best, cells // len(runs), right)
    return float(best.sum() / len(positives))


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
            f"need {images} conditions, and positives of {counted(images, 'image')} among themselves; got "
            f"{len(condition)}, {len(positives)} and {positives.references}"
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
        raise ValueError(f"need as many hits as finite factors, and 0 < level < 1; got {len(hit)}, {len(factor)}")
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
