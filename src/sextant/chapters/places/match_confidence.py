r"""The probability that a best match shows the place of its query, where that place need not be in the map.

.. math:: p(\text{right}) = \sigma(a\, g + b), \qquad
   g = s_{i\hat\jmath} - \max_{j \notin \mathcal S_{\hat\jmath}} s_{ij},

with the margin g of the best match over the best map image of another place. The remainder, :math:`1 - p`, is the
probability that the match is wrong or the place is not in the map. a and b are fitted
(``benchmarks.match_confidence_fit``) to sets of images not used in training, each with its whole map and with half of
it, so that queries without a place are included.

After re-ranking, it is from the inliers alone. With the numbers :math:`e` of the best match and :math:`e'` of its best
rival at another place, beyond the seven that any fundamental matrix fits,

.. math:: p(\text{right}) = \sigma(a\, z + b), \qquad z = \frac{e - e'}{\sqrt{e + e' + 1}},

where z is by how many standard deviations two counts of one rate differ (Przyborowski and Wilenski, 1940).

Source: J. Platt, "Probabilistic outputs for support vector machines", 1999.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy.special import expit


@dataclass(frozen=True)
class MatchConfidence:
    """The probability that a match is right.

    Attributes:
        slope: a, per unit of similarity; after re-ranking per standard deviation.
        offset: b.

    Example:
        >>> MatchConfidence(slope=24.0, offset=-2.4).probability(np.array([0.0, 0.1, 0.2])).round(2)  # even at 0.1
        array([0.08, 0.5 , 0.92])
    """

    slope: float
    offset: float

    def probability(self, margin: Float[ndarray, "m"]) -> Float64[ndarray, "m"]:
        """Probability that each match is right, by g or after re-ranking by z; nan where there is none."""
        return np.asarray(expit(self.slope * np.asarray(margin, np.float64) + self.offset))


#: matches that any fundamental matrix fits
FITTED = 7
#: default of networks trained here, fitted to all sets of ``python -m benchmarks.unseen_places run=<run>``, whose
#: scenes were not used in training
UNSEEN = MatchConfidence(24.0, -2.28)


def deviations(inliers: Float[ndarray, "m"], rival: Float[ndarray, "m"]) -> Float64[ndarray, "m"]:
    """By how many standard deviations two numbers of inliers differ, of those beyond the seven that any model fits.

    >>> deviations(np.array([31, 8]), np.array([7, 3])).round(2).tolist()
    [4.8, 0.71]
    """
    own, other = (np.maximum(0.0, np.asarray(each, np.float64) - FITTED) for each in (inliers, rival))
    return np.asarray((own - other) / np.sqrt(own + other + 1))


#: candidates that were compared; with fewer, the best rival at another place is weaker
CANDIDATES = 15
#: Longer sides, in pixels, below which a confidence after re-ranking is unknown: on pictures of 64x32 pixels the median
#: right match has 10 inliers more than its rival's 55, as wrong ones of photos of 97 pixels and more do.
LEAST_SIDE = 90
#: for XFeat at its own settings and so many candidates; fitted to all sets of large enough images of
#: ``python -m benchmarks.reranking local=xfeat side=640 fit=true``
RERANKED = MatchConfidence(0.758, -2.17)

#: what is answered about the place of a photo
Verdict = Literal["in the map", "not in the map"]


def verdict(found: float | None) -> Verdict | None:
    """Whether a place is in the map: it is not if the best match is more probably wrong than right.

    >>> verdict(0.9), verdict(0.2), verdict(None)
    ('in the map', 'not in the map', None)
    """
    return None if found is None else "in the map" if found >= 0.5 else "not in the map"
