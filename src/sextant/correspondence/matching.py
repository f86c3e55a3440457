r"""Matches of local features, those that agree with a geometry, and the tracks that they join.

Two features match where each is the other's most similar one (mutual nearest neighbours) and the cosine of their
descriptors reaches a threshold.
"""

from collections.abc import Callable
from typing import Annotated

import numpy as np
import torch
from annotated_types import Ge, Gt, Le
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from sextant.correspondence.local_features import LocalFeatures
from sextant.errors import naming_extras
from sextant.ranges import Positive, checked
from sextant.shapes import check_shape

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


@checked
def mutual_matches(
    first: LocalFeatures, second: LocalFeatures, least_cosine: Annotated[float, Ge(-1), Le(1)] = LEAST_COSINE
) -> Int64[ndarray, "m 2"]:
    """Pairs of features that are each other's most similar one.

    Args:
        first, second: features of two images.
        least_cosine: least similarity.

    Returns:
        Numbers of the features in the first and in the second image.

    Raises:
        ArgumentError: ``least_cosine`` is out of range.

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


@checked
def distinct_matches(
    first: LocalFeatures,
    second: LocalFeatures,
    least_cosine: float = LEAST_COSINE,
    ratio: Annotated[float, Gt(0), Le(1)] = DISTINCT,
) -> Int64[ndarray, "m 2"]:
    """Mutual matches whose second nearest descriptors are further away, in both images; the most distinct first.

    Args:
        first, second: features of two images.
        least_cosine: least similarity.
        ratio: largest ratio of the distances to the nearest and to the second nearest descriptor (Lowe 2004).

    Raises:
        ArgumentError: a number is out of range.

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


@checked
def epipolar_inliers(
    first: Float32[ndarray, "m 2"], second: Float32[ndarray, "m 2"], error_px: Positive = 3.0
) -> Bool[ndarray, "m"]:
    """Which matches agree with one fundamental matrix, the best of a LO-RANSAC (poselib).

    Args:
        first, second: matched pixels.
        error_px: largest distance from the epipolar lines (Sampson), pixels.

    Returns:
        All False with fewer than 8 matches, which determine nothing.

    Raises:
        ArgumentError: the pixels are no pairs of pairs, or ``error_px`` is not above 0.
    """
    check_shape("first", first, "m", 2)
    check_shape("second", second, len(first), 2)
    if len(first) < 8:
        return np.zeros(len(first), bool)
    with naming_extras("geometry of matches"):
        import poselib
    ransac = {"max_epipolar_error": error_px, "max_iterations": ITERATIONS, "min_iterations": ITERATIONS // 10}
    _, found = poselib.estimate_fundamental(first.astype(np.float64), second.astype(np.float64), ransac, {})
    return np.asarray(found["inliers"], bool)


def tracks_of(
    links: Int64[ndarray, "m 2"], image_of: Callable[[ndarray], ndarray], most: int | None = None
) -> tuple[Int64[ndarray, "n"], Int64[ndarray, "n"], Int64[ndarray, "n"]]:
    """Features that links join, at most one of an image: the features, their images and tracks, sorted by track.

    Args:
        links: pairs of features, which are numbered across images.
        image_of: the images of such numbers.
        most: tracks that are kept, the longest; None for all.

    >>> features, images, tracks = tracks_of(np.array([[1, 12], [12, 25], [3, 14], [4, 14]]), lambda n: n // 10)
    >>> features.tolist(), images.tolist(), tracks.tolist()  # 3 and 4 are of one image
    ([1, 12, 25], [0, 1, 2], [0, 0, 0])
    """
    linked, ends = np.unique(links, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = coo_matrix((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), (len(linked), len(linked)))
    _, label = connected_components(graph, directed=False)
    image = image_of(linked)
    size, images = np.bincount(label, minlength=1), 1 + int(image.max(initial=0))
    distinct = np.bincount(np.unique(label.astype(np.int64) * images + image) // images, minlength=1)
    good = distinct == size  # a track with two features of one image is of two things
    if most is not None:
        good[np.argsort(-np.where(good, size, 0), kind="stable")[most:]] = False
    rows = np.flatnonzero(good[label])
    rows = rows[np.argsort(label[rows], kind="stable")]
    return linked[rows], image[rows], np.unique(label[rows], return_inverse=True)[1].reshape(-1)
