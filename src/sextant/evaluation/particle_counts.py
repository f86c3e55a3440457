r"""The number of particles that a method needs, and its ratio to that of another method.

:math:`N_{95}` is the smallest of the counts tried at which at least 95 % of the seeds succeed. If none of them is
enough, :math:`N_{95}` is censored: it lies above the largest count tried, and a ratio with it is known only as an
interval. All ratios are represented as intervals: :math:`N_a / N_b` is in ``[least, most]``, with ``most = inf`` if a
is censored, ``least = 0`` if b is, and both if both are.

The interval for the ratio resamples seeds with replacement (a percentile bootstrap). It takes the lower quantile of the
lower ends and the upper quantile of the upper ends, so that censoring can only make it wider. Seeds are resampled
jointly for both methods and with all their runs, which share a trained model and are not independent replicates. Where
all seeds agree at every count, the resamples do not vary and the interval is a point, which reflects neither the counts
between those tried nor rarer failures.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from numpy import ndarray

from sextant.evaluation.protocols import ENOUGH_SUCCESS

#: bootstrap resamples of the seeds for the interval of a ratio
RESAMPLES = 1000


@dataclass(frozen=True)
class CountRatio:
    """How many times as many particles the first method needs as the second.

    Attributes:
        least, most: bounds of the ratio; equal unless it is censored.
        low, high: ends of the bootstrap interval.
        censored: share of the resamples in which a method never succeeded often enough.
    """

    least: float
    most: float
    low: float
    high: float
    censored: float


def particles_needed(
    counts: Int64[ndarray, " k"], successes: Bool[ndarray, "k seeds"], level: float = ENOUGH_SUCCESS
) -> float:
    """The smallest count at which a share of at least ``level`` of the seeds succeeds; inf if none does.

    Args:
        counts: numbers of particles, ascending.
        successes: whether each seed succeeded, by count and seed.
        level: required share of seeds, in (0, 1].

    Raises:
        ValueError: counts do not ascend, there is no seed, or the level is not in (0, 1].

    >>> counts, succeeded = np.array([100, 1000]), np.array([[False, True, True, True], [True] * 4])  # of four seeds
    >>> particles_needed(counts, succeeded), particles_needed(counts, succeeded, level=0.75)
    (1000.0, 100.0)
    """
    _check(counts, successes, level)
    return float(_needed(counts, successes.mean(axis=1), level))


def needed_ratio(
    first: tuple[Int64[ndarray, " k"], Bool[ndarray, "k seeds *runs"]],
    second: tuple[Int64[ndarray, " j"], Bool[ndarray, "j seeds2 *runs2"]],
    *,
    resamples: int = RESAMPLES,
) -> CountRatio:
    """The ratio of the particles that two methods need, with a 95 % percentile bootstrap interval over seeds.

    Args:
        first, second: particle counts, ascending, and the success of each seed at each, or of each run of each seed;
            both methods have the same seeds, in the same order.
        resamples: number of bootstrap resamples.

    Raises:
        ValueError: counts do not ascend, there is no seed, or the methods differ in their number of seeds.

    >>> always, counts = np.ones((2, 4), bool), np.array([100, 1000])  # four seeds succeed at either count
    >>> found = needed_ratio((counts, ~always), (counts, always))  # the first method never does, not even with 1,000
    >>> found.least, found.most
    (10.0, inf)
    """
    for method in (first, second):
        _check(*method, ENOUGH_SUCCESS)
    seeds = first[1].shape[1]
    if second[1].shape[1] != seeds:
        raise ValueError(f"both methods need the same seeds, got {seeds} and {second[1].shape[1]}")
    drawn = np.vstack([np.arange(seeds), np.random.default_rng(0).integers(0, seeds, (resamples, seeds))])
    needed = []  # with all seeds, then with each resample
    for counts, successes in (first, second):
        wins = successes.reshape(len(counts), seeds, -1).sum(axis=2)
        needed.append(_needed(counts, wins[:, drawn].sum(axis=2) / successes[0].size, ENOUGH_SUCCESS))
    least, most = _ratio(needed[0], needed[1], (float(first[0][-1]), float(second[0][-1])))
    lower, upper = least[1:], most[1:]
    return CountRatio(
        float(least[0]),
        float(most[0]),
        float(np.quantile(lower, 0.025, method="lower")),
        float(np.quantile(upper, 0.975, method="higher")),
        float((lower != upper).mean()),
    )


def _needed(counts: Int64[ndarray, " k"], rates: Float[ndarray, "k *batch"], level: float) -> Float[ndarray, "*batch"]:
    enough = rates >= level - 1e-9
    return np.asarray(np.where(enough.any(axis=0), counts[enough.argmax(axis=0)], np.inf))


def _ratio(
    first: Float[ndarray, " n"], second: Float[ndarray, " n"], largest: tuple[float, float]
) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    """The bounds ``least`` and ``most`` of the ratio."""
    least = np.where(np.isinf(second), 0.0, np.minimum(first, largest[0]) / second)
    most = np.where(np.isinf(first), np.inf, first / np.minimum(second, largest[1]))
    return least, most


def _check(counts: Int64[ndarray, " k"], successes: Bool[ndarray, "k seeds *runs"], level: float) -> None:
    if len(counts) != len(successes) or successes.size == 0 or counts[0] < 1 or (np.diff(counts) <= 0).any():
        raise ValueError(f"need positive ascending counts and seeds for each, got {counts} and {successes.shape}")
    if not 0 < level <= 1:
        raise ValueError(f"level={level} must be in (0, 1]")
