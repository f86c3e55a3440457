r"""The best matches of every query, their probabilities, and the margin of the best one.

With the similarities :math:`s_{ij}` of query i and map image j and the temperature T, the probability of the place of
map image j is

.. math:: \sum_{l \in \mathcal S_j} p(l \mid i), \qquad p(l \mid i) = \frac{e^{s_{il} / T}}{\sum_{l'} e^{s_{il'} / T}},

where :math:`\mathcal S_j` are the map images that show the same place as j, including j. It assumes that the place of
the query is in the map. The *margin* is the similarity of the best match minus that of the best map image of another
place.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import repeat
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.special import logsumexp

from sextant.errors import UserError
from sextant.evaluation.positives import Positives
from sextant.reporter import Advance
from sextant.retrieval import FlatIndex, Neighbours, SequenceMatches, match_sequences
from sextant.tables import counted

#: similarities that are held in memory at a time: 16 MiB
BLOCK = 2**22
#: most similarities of all pairs for which sequences are matched; about 4 GiB with intermediate results
LARGEST_RIDES = 2**28
#: in place of the inliers of a match that was not re-ranked
NOT_COUNTED = -1


class Match(NamedTuple):
    """A map image that a query was matched with: its number, its similarity, the probability of its place, and the
    inliers between the two where the match was re-ranked."""

    image: int
    similarity: float
    confidence: float | None
    inliers: int | None = None


class Evidence(NamedTuple):
    """What re-ranking tells of the best match of each query.

    Attributes:
        inliers: of the best match.
        rival: most inliers of a candidate of another place; nan without one, or if the query is too small.
        compared: number of candidates.
    """

    inliers: Float64[ndarray, "m"]
    rival: Float64[ndarray, "m"]
    compared: int


@dataclass(frozen=True)
class Matches:
    """The matches of all queries.

    Attributes:
        neighbours: the most similar map images.
        confidence: probability of the place of each neighbour; None without a temperature.
        margin: margin of the best match over the next place; nan where the map has no other place, or re-ranking
            replaced the best match.
        sequences: best map images by sequences of queries; None if not requested.
        inliers: of each neighbour, ``NOT_COUNTED`` beyond those that were re-ranked; None without re-ranking.
        evidence: for the best matches after re-ranking; None without it.
    """

    neighbours: Neighbours
    confidence: Float64[ndarray, "m k"] | None
    margin: Float64[ndarray, "m"]
    sequences: SequenceMatches | None
    inliers: Int64[ndarray, "m k"] | None = None
    evidence: Evidence | None = None

    def single(self, query: int) -> list[Match]:
        """The matches of a single query, the best first."""
        sure: Iterable[float | None] = repeat(None) if self.confidence is None else self.confidence[query].tolist()
        counted: Iterable[int | None] = repeat(None)
        if self.inliers is not None:
            counted = (None if each == NOT_COUNTED else each for each in self.inliers[query].tolist())
        near = self.neighbours.indices[query].tolist(), self.neighbours.values[query].tolist()
        found = zip(*near, sure, counted, strict=False)
        return [Match(*each) for each in found]

    def by_sequence(self, query: int) -> list[Match] | None:
        """The matches of the sequence that ends at a query, the best first; None if not requested."""
        if self.sequences is None:
            return None
        found = zip(self.sequences.indices[query].tolist(), self.sequences.scores[query].tolist(), strict=True)
        return [Match(image, score, None) for image, score in found]

    def margin_of(self, query: int) -> float | None:
        """The margin of the query's best match; None where the map has no other place, or the match was replaced."""
        margin = float(self.margin[query])
        return None if math.isnan(margin) else margin


def match(
    reference: FlatIndex,
    queries: FlatIndex,
    same_place: Positives,
    k: int,
    *,
    temperature: float | None,
    sequence: int | None = None,
    progress: Advance = lambda done, total: None,
) -> Matches:
    """Look every query up in the map.

    Args:
        reference: the map.
        queries: descriptors of the queries, in the order of their ride if they are matched by sequences.
        same_place: for each map image, the map images of its place, with or without itself.
        k: number of matches, in [1, n].
        temperature: temperature of the posterior over the map; None for no confidence.
        sequence: number of queries in a sequence; None for single queries only.
        progress: called with the number of queries done and the total.

    Raises:
        UserError: the two rides are too long for sequences.
        ValueError: k is out of range.
    """
    sequences = _by_sequences(reference, queries, k, sequence)
    count = len(queries)
    values, indices = np.empty((count, k), np.float32), np.empty((count, k), np.int64)
    confidence = None if temperature is None else np.empty((count, k))
    margin = np.empty(count)
    at_a_time = max(1, BLOCK // len(reference))
    for start in range(0, count, at_a_time):
        block = queries.references.rows[start : start + at_a_time]
        values[start : start + at_a_time], indices[start : start + at_a_time] = reference.search(block, k)
        for row, near in enumerate(block @ reference.references.rows.T, start):
            similarities = near.astype(np.float64)
            places = [_place(same_place, int(j)) for j in indices[row]]
            if confidence is not None:
                confidence[row] = _probabilities(similarities / temperature, places)
            similarities[places[0]] = -np.inf
            second = similarities.max()
            margin[row] = max(0.0, values[row, 0] - second) if np.isfinite(second) else np.nan
        progress(min(start + at_a_time, count), count)
    return Matches(Neighbours(values, indices), confidence, margin, sequences)


def _place(same_place: Positives, image: int) -> ndarray:
    """The map images of the place of one of them, each once."""
    return np.union1d(same_place[image], [image])


def _probabilities(scores: Float64[ndarray, "n"], places: list[ndarray]) -> list[float]:
    total = logsumexp(scores)
    return [float(min(1.0, np.exp(scores[place] - total).sum())) for place in places]


def _by_sequences(reference: FlatIndex, queries: FlatIndex, k: int, length: int | None) -> SequenceMatches | None:
    if length is None:
        return None
    check_rides(len(reference), len(queries), length)
    return match_sequences(queries.references.rows @ reference.references.rows.T, k, length=length)


def check_rides(reference: int, queries: int, length: int | None) -> None:
    """Raise a ``UserError`` if there are too many images to be matched by sequences."""
    if length is not None and queries * reference > LARGEST_RIDES:
        raise UserError(
            f"sequences of {length} need the similarities of all pairs, and {counted(queries, 'query', 'queries')} x "
            f"{reference:,} map images are more than {LARGEST_RIDES:,}",
            "Look up fewer queries at a time, or single photos.",
        )
