r"""Re-ranking of retrieved images by the matches that agree with one epipolar geometry.

The retrieval's first answer is replaced only by a candidate with significantly more inliers, so that where both show
the place the retrieval decides. A fundamental matrix passes through any seven matches, so :math:`n - 7` of n inliers
are evidence. If candidates a and b, with evidence :math:`e_a` and :math:`e_b`, were equally good, each match would
belong to either with probability one half; b is significantly better if

.. math:: P\bigl(X \ge e_b\bigr) < \frac{\alpha}{c}, \qquad X \sim \mathrm{Bin}(e_a + e_b, \tfrac12),

with the level :math:`\alpha = 0.05` divided by the number c of candidates that were compared with the first
(Bonferroni). This is the exact test that two Poisson counts have one rate (Przyborowski and Wilenski, 1940). Inliers
cluster in an image, so the level is nominal.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int64
from numpy import ndarray
from scipy.stats import binom

from sextant.correspondence.local_features import LocalFeatures, Matcher
from sextant.correspondence.matching import epipolar_inliers, mutual_matches
from sextant.ranges import Count, Positive, checked

#: matches that any fundamental matrix fits
FITTED = 7
#: the conventional level of a test
LEVEL = 0.05


@checked
def count_inliers(
    query: LocalFeatures,
    candidates: Sequence[LocalFeatures],
    *,
    side: Count = 640,
    error_px: Positive = 3.0,
    match: Matcher = mutual_matches,
) -> Int64[ndarray, "n"]:
    """The number of matches of each candidate that agree with one fundamental matrix.

    Args:
        query: features of the query.
        candidates: features of the candidates.
        side: longer side of the images in which ``error_px`` is measured: that to which they were scaled for detection.
        error_px: largest distance from the epipolar lines.
        match: matches the features of two images.

    Raises:
        ArgumentError: ``side`` or ``error_px`` is not above 0.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> unit = np.linalg.qr(rng.normal(size=(64, 64)))[0].astype(np.float16)
        >>> one = LocalFeatures(rng.uniform(0, 640, (64, 2)).astype(np.float32), unit, 640, 640)
        >>> count_inliers(one, [one, one.strongest(5)]).tolist()
        [64, 0]
    """
    found = np.zeros(len(candidates), np.int64)
    for number, candidate in enumerate(candidates):
        first, second = match(query, candidate).T
        points = _scaled(query, side)[first], _scaled(candidate, side)[second]
        found[number] = epipolar_inliers(*points, error_px).sum()
    return found


def _scaled(features: LocalFeatures, side: int) -> ndarray:
    return features.points * np.float32(side / max(features.width, features.height))


def significantly_more(inliers: int, than: int, compared: int = 1) -> bool:
    """Whether a candidate has significantly more inliers than another.

    Args:
        inliers: of the candidate.
        than: inliers of the other.
        compared: number of candidates of which this one has the most inliers.

    Example:
        >>> significantly_more(40, than=15, compared=14), significantly_more(220, than=200, compared=14)
        (True, False)
    """
    evidence, other = (max(0, each - FITTED) for each in (inliers, than))
    return bool(binom.sf(evidence - 1, evidence + other, 0.5) < LEVEL / compared)


def reranked(inliers: Int64[ndarray, "n"]) -> Int64[ndarray, "n"]:
    """The new order of candidates.

    Each position is filled in the same way: by the first of those that remain in the order of the retrieval, unless
    the one with the most inliers has significantly more.

    Args:
        inliers: of the candidates, which are in the order of the retrieval.

    Returns:
        The candidates' numbers, the best first.

    Example:
        >>> reranked(np.array([12, 16, 90, 85])).tolist()
        [2, 3, 0, 1]
    """
    left, order = list(range(len(inliers))), []
    while left:
        first, best = left[0], max(left, key=lambda number: (inliers[number], -number))
        replaced = best != first and significantly_more(int(inliers[best]), int(inliers[first]), len(left) - 1)
        order.append(best if replaced else first)
        left.remove(order[-1])
    return np.array(order, np.int64)
