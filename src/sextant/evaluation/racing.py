"""Which trials of a search deserve another seed, given what all of them have reached so far.

Scores are a matrix of trials x seeds: higher is better, nan where a seed has not been run, minus infinity where a run
had no result. The seeds of every trial are run in the same order, so two trials are compared over the seeds that both
have, seed by seed: what a seed makes easy or hard for all of them drops out.
"""

import math

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats

Scores = Float[ndarray, "trials seeds"]
#: degrees of freedom without which a variance is not relied on: the first two differences of accuracies are often equal
ENOUGH = 4


def seeds_run(scores: Scores) -> Float[ndarray, "trials"]:
    """How many seeds of each trial have been run, from the first on.

    Example:
        >>> seeds_run(np.array([[0.9, 0.8, np.nan], [0.7, np.nan, 0.6]]))  # what follows a gap does not count
        array([2, 1])
    """
    return np.asarray(np.cumprod(~np.isnan(scores), axis=1).sum(1))


def leader(scores: Scores) -> int | None:
    """The best mean among the trials with most seeds; None while no trial has a result at every seed it was run at.

    Example:
        >>> leader(np.array([[0.8, 0.7], [0.8, 0.9], [0.99, np.nan], [0.99, -np.inf]]))  # of the first two
        1
    """
    counts = np.where(_sound(scores), seeds_run(scores), 0)
    if not len(counts) or not counts.max():
        return None
    most = int(counts.max())
    means = np.where(counts == most, scores[:, :most].mean(1), -np.inf)
    return int(np.argmax(means))


def racing(scores: Scores, confidence: float = 0.95, *, last: bool = False) -> list[int]:
    r"""The trials that get another seed: those that may still beat the best, and the best once they have as many.

    A trial with :math:`n` seeds is out once the upper end of a one-sided interval of its mean paired difference
    :math:`\bar d` from the leader is not above zero,

    .. math:: \bar d + t_{\nu, c}\, s / \sqrt{n} \le 0,

    in which :math:`s^2` is the variance of paired differences, pooled over all trials that have two seeds or more, and
    :math:`\nu` its degrees of freedom: one seed is enough for a trial that is far off, once others have told what
    seeds alone make. Nothing is out while :math:`\nu < 4`. Every decision is made anew, so a trial comes back if
    another leads, or seeds turn out to make more than was thought.

    Args:
        scores: as the module says; a trial without a run deserves one.
        confidence: :math:`c`, of each comparison.
        last: no other trials will come; the best, too, gets all seeds then.

    Returns:
        Indices of trials, in order.

    Example:
        >>> nan = np.nan
        >>> best, second = [0.90, 0.92, 0.91, 0.93], [0.89, 0.93, 0.91, 0.92]
        >>> scores = np.array([best, second, [0.90, 0.91, nan, nan], [0.5, nan, nan, nan]])
        >>> racing(scores)
        [2]
    """
    counts, best, total = seeds_run(scores), leader(scores), scores.shape[1]
    fresh = [trial for trial in np.flatnonzero(_sound(scores)) if counts[trial] == 0]
    if best is None:
        return [int(trial) for trial in fresh]
    raced = [trial for trial in np.flatnonzero(_sound(scores)) if trial != best and counts[trial]]
    differences = {trial: scores[trial, : counts[trial]] - scores[best, : counts[trial]] for trial in raced}
    freedom = sum(len(found) - 1 for found in differences.values())
    squares = sum(float(((found - found.mean()) ** 2).sum()) for found in differences.values())
    reach = math.inf
    if freedom >= ENOUGH:
        reach = float(stats.t.ppf(confidence, freedom)) * math.sqrt(squares / freedom)
    contenders = [t for t, found in differences.items() if found.mean() + reach / math.sqrt(len(found)) > 0]
    deserving = {*fresh, *(trial for trial in contenders if counts[trial] < total)}
    if counts[best] < total and (last or any(counts[trial] == counts[best] for trial in contenders)):
        return sorted({*map(int, deserving), best})
    return sorted(map(int, deserving))


def halving(scores: Scores, trials: int) -> list[int]:
    """Successive halving: all trials get one seed, the better half two, the better half of these four, and so on.

    Args:
        scores: as the module says.
        trials: that there will be; no trial gets a second seed before all have one.

    Returns:
        Indices of trials, in order.

    References:
        Karnin, Koren and Somekh, Almost Optimal Exploration in Multi-Armed Bandits, ICML 2013.

    Example:
        >>> scores = np.full((4, 4), np.nan)
        >>> scores[:, 0] = [0.9, 0.5, 0.8, 0.6]
        >>> halving(scores, trials=4)
        [0, 2]
    """
    counts, total = seeds_run(scores), scores.shape[1]
    alive = np.flatnonzero(_sound(scores))
    rung, kept = 1, list(alive)
    while True:
        behind = [int(trial) for trial in kept if counts[trial] < min(rung, total)]
        if behind or rung >= total or len(scores) < trials:
            return behind
        ranked = sorted(kept, key=lambda trial: -float(scores[trial, :rung].mean()))
        kept, rung = sorted(ranked[: max(1, math.ceil(len(ranked) / 2))]), 2 * rung


def every(scores: Scores) -> list[int]:
    """All trials that have no run without a result, until they have every seed.

    Example:
        >>> every(np.array([[0.9, 0.8], [0.5, np.nan], [-np.inf, np.nan]]))  # the first has all, the last no result
        [1]
    """
    return [int(trial) for trial in np.flatnonzero(_sound(scores)) if seeds_run(scores)[trial] < scores.shape[1]]


def _sound(scores: Scores) -> ndarray:
    """The trials none of whose runs was without a result."""
    return np.asarray(~np.isneginf(scores).any(1))
