"""Fit the probability that a best match is right to sets of images; see ``chapters/places/match_confidence.py``."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.optimize import minimize
from scipy.special import log_expit

from sextant.chapters.places.match_confidence import MatchConfidence


def fit_match_confidence(sets: Sequence[tuple[Float[ndarray, "m"], Bool[ndarray, "m"]]]) -> MatchConfidence:
    """Fit a and b by maximum mean log-likelihood; each set counts the same, however many queries it has.

    Args:
        sets: margins of the best matches of each, and whether they are right.

    Raises:
        ValueError: there is no set, or one is empty or has a margin that is not finite; or some margin separates all
            right matches from all wrong ones, so that the likelihood has no maximum.

    >>> margin, right = np.repeat([0.0, 0.1], 4), np.array([1, 0, 0, 0, 1, 1, 1, 0], bool)
    >>> fit_match_confidence([(margin, right)]).probability(np.array([0.0, 0.1])).round(2)  # 1 of 4 right, and 3 of 4
    array([0.25, 0.75])
    """
    if not sets or not all(len(margin) and np.isfinite(margin).all() for margin, _ in sets):
        raise ValueError("confidence is fitted to at least one set of matches, each with finite margins")
    of_right = np.concatenate([margin[right] for margin, right in sets])
    of_wrong = np.concatenate([margin[~right] for margin, right in sets])
    if _all_below(of_right, of_wrong) or _all_below(of_wrong, of_right):
        raise ValueError(
            f"some margin separates the {len(of_right)} right matches from the {len(of_wrong)} wrong ones; a "
            "confidence can only be fitted if these overlap: add sets of images"
        )

    def loss(parameters: ndarray) -> float:
        scores = [(parameters[0] * margin + parameters[1]) * np.where(right, 1, -1) for margin, right in sets]
        return -float(np.mean([log_expit(each).mean() for each in scores]))

    slope, offset = minimize(loss, np.zeros(2)).x
    return MatchConfidence(float(slope), float(offset))


def _all_below(low: ndarray, high: ndarray) -> bool:
    if not len(low) or not len(high):
        return True
    return bool(low.max() <= high.min() and low.min() < high.max())  # all alike, they are not separated
