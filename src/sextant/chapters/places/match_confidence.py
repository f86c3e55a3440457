r"""The probability that a best match shows the place of its query, where that place need not be in the map.

.. math:: p(\text{right}) = \sigma(a\, g + b), \qquad
   g = s_{i\hat\jmath} - \max_{j \notin \mathcal S_{\hat\jmath}} s_{ij},

with the margin g of the best match over the best map image of another place. The remainder, :math:`1 - p`, is the
probability that the match is wrong or the place is not in the map. a and b are fitted to sets of images not used in
training, each with its whole map and with half of it, so that queries without a place are included.

After re-ranking, it is from the inliers alone. With the numbers :math:`e` of the best match and :math:`e'` of its best
rival at another place, beyond the seven that any fundamental matrix fits,

.. math:: p(\text{right}) = \sigma(a\, z + b), \qquad z = \frac{e - e'}{\sqrt{e + e' + 1}},

where z is by how many standard deviations two counts of one rate differ (Przyborowski and Wilenski, 1940).

Source: J. Platt, "Probabilistic outputs for support vector machines", 1999.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float64
from numpy import ndarray
from scipy.optimize import minimize
from scipy.special import expit, log_expit


@dataclass(frozen=True)
class MatchConfidence:
    """The probability that a match is right.

    Attributes:
        slope: a, per unit of similarity.
        offset: b.

    Example:
        >>> MatchConfidence(slope=24.0, offset=-2.4).probability(np.array([0.0, 0.1, 0.2])).round(2)  # even at 0.1
        array([0.08, 0.5 , 0.92])
    """

    slope: float
    offset: float

    def probability(self, margin: Float[ndarray, "m"]) -> Float64[ndarray, "m"]:
        """Probability that each match is right; nan where there is no margin."""
        return np.asarray(expit(self.slope * np.asarray(margin, np.float64) + self.offset))


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


#: matches that any fundamental matrix fits
FITTED = 7
#: default of networks trained here, fitted to all sets of ``python -m benchmarks.unseen_places run=<run>``, whose
#: scenes were not used in training
UNSEEN = MatchConfidence(24.0, -2.28)


@dataclass(frozen=True)
class RerankedConfidence:
    """The probability that a match is right after re-ranking.

    Attributes:
        slope: a, per standard deviation.
        offset: b.

    Example:
        >>> told = RerankedConfidence(slope=1.0, offset=-1.0)
        >>> told.probability(np.array([150.0, 20.0]), np.array([20.0, 20.0])).round(2)
        array([1.  , 0.27])
    """

    slope: float
    offset: float

    def probability(self, inliers: Float[ndarray, "m"], rival: Float[ndarray, "m"]) -> Float64[ndarray, "m"]:
        """Probability that each match is right; nan where a number is.

        Args:
            inliers: of the best match.
            rival: most inliers of a candidate of another place; nan without one.
        """
        return np.asarray(expit(self.slope * deviations(inliers, rival) + self.offset))


def deviations(inliers: Float[ndarray, "m"], rival: Float[ndarray, "m"]) -> Float64[ndarray, "m"]:
    """By how many standard deviations two numbers of inliers differ, of those beyond the seven that any model fits.

    >>> deviations(np.array([31, 8]), np.array([7, 3])).round(2).tolist()
    [4.8, 0.71]
    """
    own, other = (np.maximum(0.0, np.asarray(each, np.float64) - FITTED) for each in (inliers, rival))
    return np.asarray((own - other) / np.sqrt(own + other + 1))


def fit_reranked_confidence(
    sets: Sequence[tuple[Float[ndarray, "m"], Float[ndarray, "m"], Bool[ndarray, "m"]]],
) -> RerankedConfidence:
    """Fit both parameters as :func:`fit_match_confidence` does.

    Args:
        sets: inliers and inliers of the rival of the best matches of each, and whether they are right.

    Raises:
        ValueError: as there.

    >>> inliers, right = np.repeat([8, 32], 4), np.array([1, 0, 0, 0, 1, 1, 1, 0], bool)
    >>> fitted = fit_reranked_confidence([(inliers, np.full(8, 7), right)])
    >>> fitted.probability(np.array([8, 32]), np.array([7, 7])).round(2)  # 1 of 4 right, and 3 of 4
    array([0.25, 0.75])
    """
    found = fit_match_confidence([(deviations(inliers, rival), right) for inliers, rival, right in sets])
    return RerankedConfidence(found.slope, found.offset)


#: candidates that were compared; with fewer, the best rival at another place is weaker
CANDIDATES = 15
#: Longer sides, in pixels, below which a confidence after re-ranking is unknown: on pictures of 64x32 pixels the median
#: right match has 10 inliers more than its rival's 55, as wrong ones of photos of 97 pixels and more do.
LEAST_SIDE = 90
#: for XFeat at its own settings and so many candidates; fitted to all sets of large enough images of
#: ``python -m benchmarks.reranking local=xfeat side=640 fit=true``
RERANKED = RerankedConfidence(slope=0.758, offset=-2.17)

#: what is answered about the place of a photo
Verdict = Literal["in the map", "not in the map"]


def verdict(found: float | None) -> Verdict | None:
    """Whether a place is in the map: it is not if the best match is more probably wrong than right.

    >>> verdict(0.9), verdict(0.2), verdict(None)
    ('in the map', 'not in the map', None)
    """
    return None if found is None else "in the map" if found >= 0.5 else "not in the map"
