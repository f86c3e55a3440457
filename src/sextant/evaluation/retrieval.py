r"""Recall of place recognition, under names that include the protocol.

A query is *recalled at K* if one of its K most similar references is a positive. Two conventions are in use, which
differ if some queries have no positive:

- over all m queries, so that a query without a positive counts as missed (G. Berton et al., "Deep Visual
  Geo-localization Benchmark", CVPR 2022): ``R@1``,
- over the queries that have a positive (S. Schubert et al., "Visual Place Recognition: A Tutorial", 2023):
  ``R@1_matchable``.

A name such as ``R@1_pm1f_winter_to_summer`` is complete: the tolerance with its unit, then the traverse of the queries
and that of the references. Published figures on one set of images differ in all three.

Ranking at random recalls a query with p positives among n references with probability
:math:`1 - \binom{n - p}{K} / \binom{n}{K}`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Integer
from numpy import ndarray
from scipy.special import gammaln

from sextant.evaluation.positives import Positives

RANKS = (1, 5, 10, 20)


@dataclass(frozen=True)
class RetrievalProtocol:
    """The protocol behind a figure of place recognition, which is part of its name.

    Attributes:
        tolerance: largest distance at which a reference is positive.
        unit: of the tolerance: ``f`` for frames, ``m`` for metres.
        query, reference: traverses or conditions; empty if there is only one pair.
        heading_deg: tolerance of the heading in degrees, if there is one.

    Raises:
        ValueError: the unit is neither of the two, the tolerance is negative, or only one traverse is named.

    Example:
        >>> RetrievalProtocol(1, query="winter", reference="summer").name("R@1")
        'R@1_pm1f_winter_to_summer'
    """

    tolerance: float
    unit: str = "f"
    query: str = ""
    reference: str = ""
    heading_deg: float | None = None

    def __post_init__(self) -> None:
        if self.unit not in ("f", "m") or not self.tolerance >= 0:
            raise ValueError(f"need a tolerance of at least 0 in f or m; got {self.tolerance} {self.unit!r}")
        if bool(self.query) != bool(self.reference):
            raise ValueError(f"name both traverses or none; got query={self.query!r}, reference={self.reference!r}")

    def name(self, metric: str) -> str:
        """The metric's name with the protocol: ``R@1_pm1f_winter_to_summer``, ``auc_5m_30deg``."""
        size = f"pm{self.tolerance:g}f" if self.unit == "f" else f"{self.tolerance:g}m"
        heading = "" if self.heading_deg is None else f"_{self.heading_deg:g}deg"
        direction = f"_{self.query}_to_{self.reference}" if self.query else ""
        return f"{metric}_{size}{heading}{direction}"


@dataclass(frozen=True)
class Recall:
    """Recall at several K, in both conventions.

    Attributes:
        over_all: by K, over all queries; nan without queries.
        over_matchable: by K, over the queries that have a positive; nan if none has.
        chance: by K, of a random ranking, over all queries.
        queries: number of queries.
        unmatchable: number of them without a positive.

    Example:
        >>> found = recall(np.array([[0], [1]]), Positives.from_lists([[0], []], references=4), ranks=(1,))
        >>> found.over_all, found.over_matchable, found.named(RetrievalProtocol(1))["R@1_pm1f"]
        ({1: 0.5}, {1: 1.0}, 0.5)
    """

    over_all: dict[int, float]
    over_matchable: dict[int, float]
    chance: dict[int, float]
    queries: int
    unmatchable: int

    def named(self, protocol: RetrievalProtocol) -> dict[str, float]:
        """All figures under their full names."""
        return {
            **{protocol.name(f"R@{k}"): value for k, value in self.over_all.items()},
            **{protocol.name(f"R@{k}_matchable"): value for k, value in self.over_matchable.items()},
            **{protocol.name(f"R@{k}_chance"): value for k, value in self.chance.items()},
            protocol.name("queries"): float(self.queries),
            protocol.name("queries_without_positive"): float(self.unmatchable),
        }


def recall(neighbours: Integer[ndarray, "m k"], positives: Positives, ranks: Sequence[int] = RANKS) -> Recall:
    """Recall at each of ``ranks`` from the neighbours found, most similar first.

    Args:
        neighbours: references found for every query.
        positives: of the same queries.
        ranks: K; those above the number of neighbours cannot be computed.

    Raises:
        ValueError: a rank is below 1 or above the number of neighbours, or the neighbours do not match the positives.

    >>> shown = Positives.from_lists([[0], [0]], references=4)
    >>> recall(np.array([[0, 1], [2, 0]]), shown, ranks=(1, 2)).over_all  # the second query finds it second
    {1: 0.5, 2: 1.0}
    """
    if not ranks or min(ranks) < 1 or max(ranks) > neighbours.shape[1]:
        raise ValueError(f"ranks {tuple(ranks)} must be in [1, {neighbours.shape[1]}], the number of neighbours")
    found = np.logical_or.accumulate(positives.hits(neighbours), axis=1)
    matchable, queries = positives.matchable, len(positives)
    hits = {k: int(found[:, k - 1].sum()) for k in ranks}
    return Recall(
        over_all={k: _share(count, queries) for k, count in hits.items()},
        over_matchable={k: _share(count, int(matchable.sum())) for k, count in hits.items()},
        chance={k: chance_recall(positives, k) for k in ranks},
        queries=queries,
        unmatchable=positives.unmatchable,
    )


def chance_recall(positives: Positives, k: int = 1) -> float:
    """Recall@K of a random ranking over all queries, ``mean(1 - C(n - p, K) / C(n, K))``; nan without queries.

    Raises:
        ValueError: k is not in [1, n].

    >>> shown = Positives.from_lists([[0, 1]], references=4)
    >>> round(chance_recall(shown), 2), round(chance_recall(shown, k=2), 2)  # 2 of 4; two are both wrong in 1 of 6
    (0.5, 0.83)
    """
    n = positives.references
    if not 1 <= k <= n:
        raise ValueError(f"k={k} must be in [1, {n}], the number of references")
    if not len(positives):
        return float("nan")
    missable = np.maximum(n - positives.counts, 0).astype(float)
    # C(n - p, K) / C(n, K) = (n - p)! (n - K)! / ((n - p - K)! n!), which is 0 if fewer than K are wrong
    rest = np.maximum(missable - k, 0)
    log_miss = gammaln(missable + 1) + gammaln(n - k + 1) - gammaln(rest + 1) - gammaln(n + 1)
    return float(np.where(missable < k, 1.0, -np.expm1(log_miss)).mean())


def _share(count: int, of: int) -> float:
    return count / of if of else float("nan")
