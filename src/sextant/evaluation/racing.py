"""Which trials of a hyperparameter search deserve another seed, given all results so far.

Scores are a matrix of trials x seeds: higher is better, nan where a seed has not been run, minus infinity where a run
had no result. The seeds of every trial are run in the same order, so two trials are compared seed by seed over the
seeds that both have, which cancels the difficulty of a seed that they share.
"""

import math

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats

Scores = Float[ndarray, "trials seeds"]
#: least degrees of freedom to rely on a variance: the first two differences of accuracies are often equal
ENOUGH = 4


def seeds_run(scores: Scores) -> Float[ndarray, "trials"]:
    """Number of seeds of each trial that have been run, from the first without a gap.

    Example:
        >>> seeds_run(np.array([[0.9, 0.8, np.nan], [0.7, np.nan, 0.6]]))  # what follows a gap does not count
        array([2, 1])
    """
    return np.asarray(np.cumprod(~np.isnan(scores), axis=1).sum(1))


def leader(scores: Scores) -> int | None:
    """The trial with the best mean among those with most seeds; None until a trial has a result for all its seeds.

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
    r"""The trials that get another seed: those that may still beat the best, and the best if one of them has as many.

    A trial with :math:`n` seeds is eliminated once the upper end of a one-sided interval for its mean paired difference
    :math:`\bar d` from the leader is not above zero,

    .. math:: \bar d + t_{\nu, c}\, s / \sqrt{n} \le 0,

    where :math:`s^2` is the variance of paired differences, pooled over all trials with two seeds or more, and
    :math:`\nu` its degrees of freedom. One seed is thus enough to eliminate a trial that is far off, once the variance
    over seeds is known from others. Nothing is eliminated while :math:`\nu < 4`. Every decision is made anew, so a
    trial may return if another takes the lead or the estimated variance grows.

    Args:
        scores: as in the module; trials without a run are always returned.
        confidence: :math:`c`, of each comparison.
        last: no other trials will follow; then the best gets all seeds too.

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
    """Successive halving: all trials get one seed, the better half two, the better half of those four, and so on.

    Args:
        scores: as in the module.
        trials: total number of trials; none gets a second seed before all have one.

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
    """All trials without a failed run, until they have every seed.

    Example:
        >>> every(np.array([[0.9, 0.8], [0.5, np.nan], [-np.inf, np.nan]]))  # the first has all, the last no result
        [1]
    """
    return [int(trial) for trial in np.flatnonzero(_sound(scores)) if seeds_run(scores)[trial] < scores.shape[1]]


def _sound(scores: Scores) -> ndarray:
    """Which trials have no failed run."""
    return np.asarray(~np.isneginf(scores).any(1))
