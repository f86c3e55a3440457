r"""Precision and recall of place recognition as the threshold on similarity decreases.

*Single best match*: each query proposes its most similar reference, which is accepted if its similarity is at least the
threshold. With TP right and FP wrong matches among those accepted, and M queries that have a positive,

.. math:: P = \frac{TP}{TP + FP}, \qquad R = \frac{TP}{M} .

The best match of a query without a positive is always wrong. *All pairs*: every pair of query and reference is accepted
or rejected on its own, and M is the number of positive pairs.

Published implementations differ; the choices made here are:

- Recall is over the queries that have a positive, so that a method that finds few never reaches 1. A general-purpose
  curve over the best matches divides by the number of right ones instead and always ends at 1, which flatters.
- Every distinct similarity is a threshold, and equal ones are accepted together; a fixed grid of 100 thresholds misses
  those at which precision is still 1.
- The curve starts at recall 0 with precision 1, where nothing is accepted.
- ``auc`` is the area by the trapezoid rule over that curve (S. Schubert et al., "Visual Place Recognition: A Tutorial",
  2023); ``average_precision`` is :math:`\sum_t (R_t - R_{t-1}) P_t`, which does not interpolate. They differ.
- Recall at precision p is the largest recall of all thresholds with precision at least p, even if precision was lower
  in between. The interpolated precision :math:`\max_{r' \ge r} P(r')` gives the same value.
- ``extended_precision`` is the mean of the precision at the lowest recall above 0 and of the recall at precision 1
  (M. Zaffar et al., "VPR-Bench", IJCV 2021); here the lowest recall is that of the first threshold.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Integer
from numpy import ndarray

from sextant.evaluation.positives import Positives
from sextant.evaluation.retrieval import RetrievalProtocol


@dataclass(frozen=True)
class PrecisionRecall:
    """A precision-recall curve from recall 0 on, as the threshold decreases.

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

    @property
    def extended_precision(self) -> float:
        """Mean of the precision at the first threshold and of the recall at precision 1; nan without a positive."""
        first = float(self.precision[1]) if len(self.precision) > 1 else 0.0
        return (first + self.recall_at_precision(1)) / 2

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
    """The curve of candidates from their similarities; ``positives`` of them could be right.

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
