r"""Matches of local features, and those that agree with a geometry.

Two features match where each is the other's most similar one (mutual nearest neighbours) and the cosine of their
descriptors reaches a threshold.
"""

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray

from sextant.correspondence.local_features import LocalFeatures
from sextant.errors import naming_extras

#: least cosine of matching descriptors: 0.75 to 0.8 did equally well where it was varied, 0.82 is XFeat's own
LEAST_COSINE = 0.75
#: largest ratio of the distances to the nearest and the second nearest descriptor of a distinct match. On the entrance
#: of ``strecha_posed`` 9 to 20 % of the inliers of a fundamental matrix join a window with its neighbour; 5 to 16 % at
#: 0.9, and a quarter of all matches is left at 0.85
DISTINCT = 0.9
#: features that are compared with all others at once: 4 MB of similarities for 4,096 features
BLOCK = 256
#: most samples of seven matches that are drawn; 1,000 take twice the time, and placed one more of 100 queries of
#: Gardens Point by day rightly
ITERATIONS = 200


def mutual_matches(
    first: LocalFeatures, second: LocalFeatures, least_cosine: float = LEAST_COSINE
) -> Int64[ndarray, "m 2"]:
    """Pairs of features that are each other's most similar one.

    Args:
        first, second: features of two images.
        least_cosine: least similarity.

    Returns:
        Numbers of the features in the first and in the second image.

    Example:
        >>> points, unit = np.zeros((2, 2), np.float32), np.eye(2, 64, dtype=np.float16)
        >>> one = LocalFeatures(points, unit, 8, 8)
        >>> mutual_matches(one, LocalFeatures(points, unit[::-1], 8, 8)).tolist()
        [[0, 1], [1, 0]]
    """
    if not len(first) or not len(second):
        return np.empty((0, 2), np.int64)
    a, b = (torch.from_numpy(np.ascontiguousarray(each.descriptors)).float() for each in (first, second))
    columns, rows = b.T.contiguous(), np.arange(BLOCK)
    best, nearest = np.empty(len(a), np.float32), np.empty(len(a), np.int64)
    highest = np.full(len(b), -2, np.float32)
    memory = torch.empty(min(BLOCK, len(a)), len(b))
    for start in range(0, len(a), BLOCK):  # a block of similarities stays in the cache
        block = slice(start, start + BLOCK)
        here = memory[: len(a[block])]
        # products by torch are faster, maxima by NumPy
        similarity = torch.mm(a[block], columns, out=here).numpy()
        nearest[block] = similarity.argmax(1)
        best[block] = similarity[rows[: len(here)], nearest[block]]
        np.maximum(highest, similarity.max(0), out=highest)
    (mutual,) = np.nonzero((best >= least_cosine) & (best >= highest[nearest]))
    pairs = np.column_stack([mutual, nearest[mutual]])
    _, once = np.unique(pairs[:, 1], return_index=True)  # of equal descriptors, the first
    return pairs[np.sort(once)]


def distinct_matches(
    first: LocalFeatures, second: LocalFeatures, least_cosine: float = LEAST_COSINE, ratio: float = DISTINCT
) -> Int64[ndarray, "m 2"]:
    """Mutual matches whose second nearest descriptors are further away, in both images; the most distinct first.

    Args:
        first, second: features of two images.
        least_cosine: least similarity.
        ratio: largest ratio of the distances to the nearest and to the second nearest descriptor (Lowe 2004).

    >>> points, unit = np.zeros((2, 2), np.float32), np.ones((2, 64), np.float16) / 8
    >>> distinct_matches(*[LocalFeatures(points, unit, 8, 8)] * 2).tolist()  # the two features of an image are alike
    []
    """
    pairs = mutual_matches(first, second, least_cosine)
    ratios = np.maximum(_ratios(first, second, pairs[:, 0]), _ratios(second, first, pairs[:, 1]))
    order = np.argsort(ratios, kind="stable")
    return np.asarray(pairs[order[ratios[order] <= ratio]])


def _ratios(first: LocalFeatures, second: LocalFeatures, rows: Int64[ndarray, "m"]) -> ndarray:
    """Distance of each feature to its nearest in the other image over that to the second nearest."""
    if len(second) < 2:
        return np.ones(len(rows))
    ours = torch.from_numpy(first.descriptors[rows]).float()
    columns = torch.from_numpy(np.ascontiguousarray(second.descriptors)).float().T.contiguous()
    blocks = [(block @ columns).topk(2, 1).values for block in ours.split(BLOCK)]
    squared = (2 - 2 * torch.cat(blocks)).clip(min=1e-6) if blocks else torch.ones(0, 2)
    return np.asarray((squared[:, 0] / squared[:, 1]).sqrt().numpy())


def epipolar_inliers(
    first: Float32[ndarray, "m 2"], second: Float32[ndarray, "m 2"], error_px: float = 3.0
) -> Bool[ndarray, "m"]:
    """Which matches agree with one fundamental matrix, the best of a LO-RANSAC (poselib).

    Args:
        first, second: matched pixels.
        error_px: largest distance from the epipolar lines (Sampson), pixels.

    Returns:
        All False with fewer than 8 matches, which determine nothing.
    """
    if len(first) < 8:
        return np.zeros(len(first), bool)
    with naming_extras("geometry of matches"):
        import poselib
    ransac = {"max_epipolar_error": error_px, "max_iterations": ITERATIONS, "min_iterations": ITERATIONS // 10}
    _, found = poselib.estimate_fundamental(first.astype(np.float64), second.astype(np.float64), ransac, {})
    return np.asarray(found["inliers"], bool)
