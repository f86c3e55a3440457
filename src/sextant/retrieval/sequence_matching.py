r"""Sequence matching for place recognition: similarities summed along lines of constant velocity.

For similarities :math:`s_{ij}` of query frame i and reference frame j, each in the order of its traverse, the sequence
of the L queries up to i is compared with references at velocity v (reference frames per query frame) that end at j:

.. math:: S_{ij} = \max_v \frac{1}{|\mathcal L_i|} \sum_{l \in \mathcal L_i} s_{i - l,\; j - [v l]},
   \qquad l = 0, 1, \dots, L - 1 ,

with :math:`[\cdot]` the nearest whole number and only those lags whose query exists. Where the line leaves the
reference traverse, the mean similarity of that query is used, which favours no place.

Only past queries are used, so that it can run online; ``centred`` takes half of the sequence from the future, as the
published programs do. With the single velocity 1 it is the sum along the diagonal, for aligned traverses.

Sources: M. Milford and G. Wyeth, "SeqSLAM: Visual Route-Based Navigation for Sunny Summer Days and Stormy Winter
Nights", ICRA 2012; the velocities 0.8, 0.9, ..., 1.2, length 10 and contrast window 10 are the defaults of OpenSeqSLAM
and pySeqSLAM (N. Sünderhauf, 2013).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int64
from numpy import ndarray

LENGTH = 10
VELOCITIES = (0.8, 0.9, 1.0, 1.1, 1.2)
CONTRAST_WINDOW = 10


class SequenceMatches(NamedTuple):
    """Best references of each query's sequence, best first; ties go to the lower index.

    Attributes:
        scores: mean similarity along the best line.
        indices: indices of the reference frames that the lines pass at the query.
    """

    scores: Float32[ndarray, "m k"]
    indices: Int64[ndarray, "m k"]


def match_sequences(
    similarities: Float[ndarray, "m n"],
    k: int = 1,
    *,
    length: int = LENGTH,
    velocities: Sequence[float] = VELOCITIES,
    centred: bool = False,
    contrast_window: int | None = None,
) -> SequenceMatches:
    """The k references that best fit the sequence of every query.

    >>> ride = np.eye(6)  # every query is most similar to the reference of its own number
    >>> match_sequences(ride, length=3).indices[:, 0]
    array([0, 1, 2, 3, 4, 5])

    Args:
        similarities: higher is more alike; rows are queries, columns references, both in the order of their traverses.
        k: references for each query, in [1, n].
        length: length of a sequence in query frames, at least 1; the first queries have shorter ones.
        velocities: reference frames per query frame; negative ones for traverses in opposite directions.
        centred: the query is in the middle of its sequence and not at its end.
        contrast_window: if given, ``local_contrast`` is applied first, with that window.

    Raises:
        ValueError: a parameter is out of range, or a similarity is not finite.
    """
    if not 1 <= k <= similarities.shape[1]:
        raise ValueError(f"k={k} must be in [1, {similarities.shape[1]}], the number of reference frames")
    if contrast_window is not None:
        similarities = local_contrast(similarities, contrast_window)
    scores = sequence_scores(similarities, length, velocities, centred=centred)
    # both break ties by the first; sorting all for the best alone would cost more than the scores
    order = scores.argmax(axis=1)[:, None] if k == 1 else np.argsort(-scores, axis=1, kind="stable")[:, :k]
    return SequenceMatches(np.take_along_axis(scores, order, axis=1), order)


def sequence_scores(
    similarities: Float[ndarray, "m n"],
    length: int = LENGTH,
    velocities: Sequence[float] = VELOCITIES,
    *,
    centred: bool = False,
) -> Float32[ndarray, "m n"]:
    """``S`` of the module for all pairs of query and reference.

    This costs m n additions for every lag and velocity, and memory for three matrices like the one given.

    >>> sequence_scores(np.eye(4), length=2, velocities=[1.0])[3].argmax()
    np.int64(3)

    Args:
        similarities, length, velocities, centred: as for :func:`match_sequences`.

    Raises:
        ValueError: a parameter is out of range, or a similarity is not finite.
    """
    if length < 1 or not velocities or not np.isfinite(velocities).all():
        raise ValueError(f"need length >= 1 and finite velocities; got length={length}, velocities={velocities}")
    if similarities.ndim != 2 or similarities.size == 0 or not np.isfinite(similarities).all():
        raise ValueError(f"need finite similarities (m, n); got {similarities.shape}, or one is not finite")
    ahead = length // 2 if centred else 0
    lags = np.arange(length) - ahead
    mean = similarities.mean(axis=1, keepdims=True, dtype=np.float64).astype(np.float32)
    given = similarities.astype(np.float32) - mean  # so that what lies outside the reference traverse is 0
    queries = np.arange(len(given))
    counts = ((queries[:, None] >= lags) & (queries[:, None] - lags < len(given))).sum(1, keepdims=True)
    offset = _shifted_sum(np.broadcast_to(mean, given.shape)[:, :1], [(lag, 0) for lag in lags.tolist()])
    best = np.full(given.shape, -np.inf, np.float32)
    for line in sorted({tuple(int(step) for step in np.rint(lags * velocity)) for velocity in velocities}):
        np.maximum(best, _shifted_sum(given, list(zip(lags.tolist(), line, strict=True))), out=best)
    return np.asarray((best + offset) / counts.astype(np.float32))


def local_contrast(
    similarities: Float[ndarray, "m n"], window: int = CONTRAST_WINDOW, floor: float = 1e-6
) -> Float32[ndarray, "m n"]:
    r"""Each similarity against those of the same query to references nearby: :math:`(s - \mu_w) / \max(\sigma_w, f)`.

    Mean and standard deviation are over the references within ``window // 2`` frames on either side, fewer at the ends
    of the traverse. This removes what whole stretches of the reference have in common.

    >>> local_contrast(np.array([[0.8, 0.8, 0.9, 0.8, 0.8]]), window=5).argmax()
    np.int64(2)

    Args:
        similarities: as for :func:`match_sequences`.
        window: in frames, at least 2.
        floor: f; smaller standard deviations are rounding errors.

    Raises:
        ValueError: the window is below 2.
    """
    if window < 2:
        raise ValueError(f"window={window} must be at least 2 frames")
    count, half = similarities.shape[1], window // 2
    # about the row's mean: the squares are differences of sums, which would cancel otherwise
    wide = similarities - similarities.mean(axis=1, keepdims=True, dtype=np.float64)
    low, high = np.maximum(np.arange(count) - half, 0), np.minimum(np.arange(count) + half + 1, count)
    mean, squares = (_window_mean(values, low, high) for values in (wide, wide**2))
    spread = np.sqrt(np.maximum(squares - mean**2, 0))
    return np.asarray(((wide - mean) / np.maximum(spread, floor)).astype(np.float32))


def _window_mean(values: ndarray, low: ndarray, high: ndarray) -> ndarray:
    sums = np.concatenate([np.zeros((len(values), 1)), values.cumsum(axis=1)], axis=1)
    return np.asarray((sums[:, high] - sums[:, low]) / (high - low))


def _shifted_sum(values: Float32[ndarray, "m n"], shifts: Sequence[tuple[int, int]]) -> Float32[ndarray, "m n"]:
    """Sum over (a, b) of ``values[i - a, j - b]``, 0 where that lies outside."""
    total = np.zeros(values.shape, np.float32)
    for shift in shifts:
        if all(abs(step) < size for step, size in zip(shift, values.shape, strict=True)):
            target = tuple(
                slice(max(step, 0), size + min(step, 0)) for step, size in zip(shift, values.shape, strict=True)
            )
            source = tuple(
                slice(max(-step, 0), size - max(step, 0)) for step, size in zip(shift, values.shape, strict=True)
            )
            total[target] += values[source]
    return total
