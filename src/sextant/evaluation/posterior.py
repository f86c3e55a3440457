r"""The probability that a descriptor assigns to the correct places: a posterior over the references.

.. math:: p(j \mid i) = \frac{e^{s_{ij} / T}}{\sum_{j'} e^{s_{ij'} / T}}, \qquad
   \mathrm{NLL} = -\frac{1}{M} \sum_{i \in M} \log \sum_{j \in P_i} p(j \mid i) \quad \text{(nats)}

over the M queries that have a positive; the others have no correct place and are counted separately. For query i, a
posterior that is uniform over the n references has the value :math:`\log n - \log |P_i|`. The temperature T, in the
unit of the similarity, is fitted on queries other than those it is reported for.

Source: temperature scaling is that of C. Guo et al., "On Calibration of Modern Neural Networks", ICML 2017.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

from sextant.evaluation.positives import Positives
from sextant.evaluation.retrieval import RetrievalProtocol

#: Range of temperatures tried, in standard deviations of the similarities: from certainty of one place to uniform.
RANGE = (1e-3, 1e3)
STEPS = 49
#: Entries in float64 held at a time: 8 MiB.
BLOCK = 2**20


@dataclass(frozen=True)
class PlacePosterior:
    """The quality of a posterior over places.

    Attributes:
        nll: mean negative log-likelihood in nats over the queries that have a positive; nan if none has.
        chance: the same for a uniform posterior.
        temperature: of the softmax.
        queries: number of queries.
        unmatchable: number of them without a positive.

    Example:
        >>> place = Positives.from_lists([[0]], references=2)
        >>> list(place_posterior(np.array([[0.9, 0.1]]), place, temperature=0.5).named(RetrievalProtocol(1)))
        ['place_nll_pm1f', 'place_nll_uniform_pm1f', 'place_temperature_pm1f']
    """

    nll: float
    chance: float
    temperature: float
    queries: int
    unmatchable: int

    def named(self, protocol: RetrievalProtocol) -> dict[str, float]:
        """The figures under their full names."""
        figures = {"place_nll": self.nll, "place_nll_uniform": self.chance, "place_temperature": self.temperature}
        return {protocol.name(name): value for name, value in figures.items()}


def place_posterior(similarities: Float[ndarray, "m n"], positives: Positives, temperature: float) -> PlacePosterior:
    """The posterior's negative log-likelihood at a temperature fitted elsewhere.

    Args:
        similarities: of all pairs of query and reference; higher is more similar.
        positives: of the queries.
        temperature: above 0, in the unit of the similarities.

    Raises:
        ValueError: there is no reference, shapes differ, a similarity is not finite, or the temperature is not above 0.

    >>> place = Positives.from_lists([[0]], references=2)
    >>> found = place_posterior(np.log([[3.0, 1.0]]), place, temperature=1.0)  # 3/4 for the right one of two
    >>> f"{found.nll:.3f}, by chance {found.chance:.3f}"  # ln 4/3 and ln 2
    '0.288, by chance 0.693'
    """
    _check(similarities, positives)
    if not (temperature > 0 and np.isfinite(temperature)):
        raise ValueError(f"temperature={temperature} must be above 0 and finite")
    return PlacePosterior(
        _nll(similarities, positives, temperature),
        _mean(np.log(positives.references) - np.log(positives.counts[positives.matchable])),
        temperature,
        len(positives),
        positives.unmatchable,
    )


def fit_temperature(similarities: Float[ndarray, "m n"], positives: Positives) -> float:
    """Fit the temperature with the smallest negative log-likelihood, from validation queries.

    The likelihood may have several maxima, so a grid over ``RANGE`` standard deviations of the similarities is searched
    first and its best point refined. Queries without a positive do not contribute.

    Raises:
        ValueError: there is no reference, shapes differ, a similarity is not finite, all are equal, or no query has a
            positive.

    >>> places = Positives.from_lists([[0], [0], [0], [1]], references=2)
    >>> found = fit_temperature(np.tile([1.0, 0.0], (4, 1)), places)  # the first reference is right in 3 of 4
    >>> f"{1 / found:.2f}"  # ln 3, which gives it 3/4
    '1.10'
    """
    _check(similarities, positives)
    spread = float(similarities.std(dtype=np.float64))
    if spread == 0 or not positives.matchable.any():
        raise ValueError("fitting a temperature needs similarities that differ and a query with a positive")
    grid = np.linspace(np.log(RANGE[0]), np.log(RANGE[1]), STEPS) + np.log(spread)
    losses = [_nll(similarities, positives, float(np.exp(log))) for log in grid]
    best = int(np.argmin(losses))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, STEPS - 1)]
    refined = minimize_scalar(
        lambda log: _nll(similarities, positives, float(np.exp(log))),
        bounds=bounds,
        method="bounded",
        options={"xatol": 1e-4},
    )
    return float(np.exp(refined.x if refined.fun <= losses[best] else grid[best]))


def _nll(similarities: Float[ndarray, "m n"], positives: Positives, temperature: float) -> float:
    queries = np.flatnonzero(positives.matchable)
    values = np.empty(len(queries))
    at_a_time = max(1, BLOCK // positives.references)
    for start in range(0, len(queries), at_a_time):
        some = queries[start : start + at_a_time]
        scores = similarities[some].astype(np.float64) / temperature
        counts = positives.counts[some]
        row, first = np.repeat(np.arange(len(some)), counts), np.cumsum(counts) - counts
        # queries without a positive have no indices, so the indices of these queries are contiguous
        right = scores[row, positives.indices[positives.starts[some[0]] : positives.starts[some[-1] + 1]]]
        highest = np.maximum.reduceat(right, first)
        among = highest + np.log(np.add.reduceat(np.exp(right - highest[row]), first))
        values[start : start + at_a_time] = logsumexp(scores, axis=1) - among
    return _mean(values)


def _mean(values: ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _check(similarities: Float[ndarray, "m n"], positives: Positives) -> None:
    if not positives.references:
        raise ValueError("a posterior over places needs a reference")
    if similarities.shape != (len(positives), positives.references):
        raise ValueError(f"need similarities {(len(positives), positives.references)}; got {similarities.shape}")
    if not np.isfinite(similarities).all():
        raise ValueError("a similarity is not finite")
