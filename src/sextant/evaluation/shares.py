"""An interval for the mean of shares over seeds that stays within [0, 1]."""

import math

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats

#: tolerance for rounding, by which means may leave [0, 1] or differ
ROUNDING = 1e-12


def share_interval(
    values: Float[ndarray, "seeds"], trials: int | None = None, confidence: float = 0.95
) -> tuple[float, float]:
    """Korn and Graubard's interval for a mean share over seeds, such as an accuracy; nan with fewer than two seeds.

    A t interval for shares near 0 or 1 leaves their range and covers the mean too rarely: for ten seeds that succeed in
    99 % of 8 runs each, 55 times in 100 (``tests/evaluation/test_share_interval.py``). Here the spread over seeds gives
    the number of independent trials that would determine the mean p equally well,

        n = p (1 - p) / (s² / S),    n' = n (z / t_{S-1})²,

    and the interval is Clopper and Pearson's of p n' successes in n' trials. For shares that scatter little compared
    with their distance from 0 and 1, it is the t interval. If a few seeds differ greatly from all others, this interval
    covers too rarely as well, as does any that is based on the observed seeds alone.

    Args:
        values: one share per seed, in [0, 1].
        trials: number of trials of all seeds together. If all seeds agree and so show no spread, this many independent
            trials are assumed; without it the interval is then nan.
        confidence: coverage, in (0, 1).

    Returns:
        The ends, in [0, 1].

    Raises:
        ValueError: a value is outside of [0, 1].

    Source: Korn & Graubard, Confidence intervals for proportions with small expected number of positive counts
    estimated from survey data, Survey Methodology 24(2), 1998; seeds are its clusters.

    >>> low, high = share_interval(np.array([1.0, 1.0, 0.875, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]))
    >>> f"{low:.3f} to {high:.3f}"
    '0.917 to 1.000'
    """
    shares = np.asarray(values, float)
    if ((shares < -ROUNDING) | (shares > 1 + ROUNDING)).any():
        raise ValueError(f"shares must be in [0, 1], got {shares.min()} to {shares.max()}")
    if len(shares) < 2:
        return (math.nan, math.nan)
    return share_interval_of(float(shares.mean()), float(shares.std(ddof=1)), len(shares), trials, confidence)


def share_interval_of(
    mean: float, spread: float, seeds: int, trials: int | None = None, confidence: float = 0.95
) -> tuple[float, float]:
    """:func:`share_interval` for shares of which only the mean and standard deviation over seeds are known.

    >>> low, high = share_interval_of(1.0, 0.0, seeds=10, trials=80)  # all of 80 runs succeeded
    >>> f"{low:.3f} to {high:.3f}"
    '0.940 to 1.000'
    """
    if seeds < 2 or not (math.isfinite(mean) and math.isfinite(spread)):
        return (math.nan, math.nan)
    variance = spread**2 / seeds
    if spread > ROUNDING:
        effective = mean * (1 - mean) / variance
    elif trials is not None:
        effective = float(trials)
    else:
        return (math.nan, math.nan)
    tail = (1 + confidence) / 2
    effective *= (stats.norm.ppf(tail) / stats.t.ppf(tail, seeds - 1)) ** 2
    successes = mean * effective
    low = stats.beta.ppf((1 - confidence) / 2, successes, effective - successes + 1)
    high = stats.beta.isf((1 - confidence) / 2, successes + 1, effective - successes)
    return (0.0 if mean <= 0 else float(low), 1.0 if mean >= 1 else float(high))  # for none or all, one end is nan


def median_error(errors: Float[ndarray, "n"]) -> float:
    """The median; nan counts as an infinite error.

    >>> median_error(np.array([1.0, 2.0, np.nan]))
    2.0
    """
    ordered = np.sort(np.where(np.isnan(errors), np.inf, errors))
    low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
    return float(low if low == high else (low + high) / 2)  # the difference of infinite errors would be nan
