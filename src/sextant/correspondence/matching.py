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
    columns = b.T.contiguous()
    best, nearest = torch.empty(len(a)), torch.zeros(len(a), dtype=torch.int64)
    highest = torch.full((len(b),), -2.0)
    for start in range(0, len(a), BLOCK):  # a block of similarities stays in the cache
        similarity = a[start : start + BLOCK] @ columns
        top = best[start : start + BLOCK] = similarity.amax(1)
        torch.maximum(highest, similarity.amax(0), out=highest)
        (enough,) = torch.where(top >= least_cosine)
        nearest[start + enough] = similarity[enough].argmax(1)
    (rows,) = torch.where((best >= least_cosine) & (best >= highest[nearest]))
    pairs = torch.stack([rows, nearest[rows]], 1).numpy()
    _, once = np.unique(pairs[:, 1], return_index=True)  # of equal descriptors, the first
    return pairs[np.sort(once)]


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
