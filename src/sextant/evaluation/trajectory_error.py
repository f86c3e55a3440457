r"""Absolute and relative trajectory errors (ATE and RPE), as the tool evo defines them.

With :math:`Q_i` the reference and :math:`P_i` the estimated pose at frame i,

.. math:: \mathrm{ATE}_i = \|t(P_i) - t(Q_i)\|, \qquad
   \mathrm{RPE}_{ij} = \|t\big((Q_i^{-1} Q_j)^{-1} (P_i^{-1} P_j)\big)\|

or the angle of the rotation in place of the length of the translation t. The estimate may first be aligned by the rigid
motion or similarity that brings its positions nearest to the reference in the least squares sense.

Poses are ``(n, 3)`` triples x, y, heading (radians), or ``(n, 4, 4)`` matrices. Rotations are inverted by
transposition; for poses with few digits, the inverse matrix would differ.

Sources: S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", TPAMI 13(4),
1991; J. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012; the conventions (pairs, their
ends, statistics) are those of M. Grupp's evo 1.38, against whose results the tests compare.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.spatial.transform import Rotation

from sextant.errors import ArgumentError
from sextant.ranges import Count, checked

Poses = Float[ndarray, "n 3"] | Float[ndarray, "n 4 4"]
Alignment = Literal["none", "rigid", "similarity"]
Part = Literal["translation", "rotation_deg"]
Spans = Sequence[tuple[int, int]]
#: extent up to which a run counts as standing still, in the unit of its positions
STILL = 1e-3
#: lengths of KITTI's segments in metres
SEGMENTS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of the errors of a trajectory, in their unit; ``std`` divides by n, ``sse`` is the sum of squares."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    sse: float

    @classmethod
    def of(cls, errors: Float[ndarray, " n"]) -> "ErrorStatistics":
        """The statistics of errors.

        Raises:
            ValueError: there is none.

        >>> found = ErrorStatistics.of(np.array([1.0, 7.0]))
        >>> found.rmse, found.mean, found.std  # 5² = 4² + 3²
        (5.0, 4.0, 3.0)
        """
        if errors.size == 0:
            raise ValueError("there are no errors to summarize: no frame, or no pair of poses at this distance")
        squares = errors**2
        return cls(
            float(np.sqrt(squares.mean())),
            float(errors.mean()),
            float(np.median(errors)),
            float(errors.std()),
            float(errors.min()),
            float(errors.max()),
            float(squares.sum()),
        )


@checked
def absolute_errors(
    reference: Poses, estimate: Poses, *, alignment: Alignment = "none", part: Part = "translation"
) -> Float[ndarray, " n"]:
    """The error of each pose: metres, or degrees of rotation in [0, 180].

    Args:
        reference, estimate: poses of the same frames: x, y (metres) and heading (radians), or 4 x 4 matrices.
        alignment: transformation by which the estimate is first aligned.
        part: part of the error.

    Raises:
        ValueError: shapes differ, or the positions do not determine the alignment.
        ArgumentError: an alignment or part is not one of these, or a pose to be aligned is not finite.

    >>> truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    >>> shifted = truth + [0.5, 0.0, 0.0]
    >>> absolute_errors(truth, shifted), absolute_errors(truth, shifted, alignment="rigid").round(6)
    (array([0.5, 0.5, 0.5]), array([0., 0., 0.]))
    """
    truth, guess = _matrices(reference, estimate)
    if alignment != "none":
        guess = align(truth, guess, scaled=alignment == "similarity")
    if part == "translation":
        return np.asarray(np.linalg.norm(guess[:, :-1, -1] - truth[:, :-1, -1], axis=1))
    return _angle_deg(_between(truth, guess))


@checked
def relative_errors(
    reference: Poses, estimate: Poses, *, delta: Count = 1, part: Part = "translation"
) -> Float[ndarray, " pairs"]:
    """The error of the motion between poses ``delta`` frames apart: metres, or degrees in [0, 180].

    Each pair starts where the last one ended.

    Args:
        reference, estimate: poses of the same frames: x, y (metres) and heading (radians), or 4 x 4 matrices.
        delta: number of frames from the first to the second pose of a pair.
        part: part of the error.

    Raises:
        ValueError: shapes differ.
        ArgumentError: the number of frames is not a whole number above 0, or the part is not one of these.

    >>> truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    >>> relative_errors(truth, truth * [1.1, 1.0, 1.0] + [5.0, 0.0, 0.0]).round(6)  # 10 % too long; the start is free
    array([0.1, 0.1])
    """
    truth, guess = _matrices(reference, estimate)
    first = np.arange(0, max(len(truth) - delta, 0), delta)
    second = first + delta
    motions = _between(truth[first], truth[second]), _between(guess[first], guess[second])
    errors = _between(*motions)
    return np.asarray(np.linalg.norm(errors[:, :-1, -1], axis=1)) if part == "translation" else _angle_deg(errors)


def segment_errors(
    reference: Poses, estimate: Poses, *, lengths_m: Sequence[float] = SEGMENTS_M, every: int = 10
) -> tuple[Float[ndarray, " segments"], Float[ndarray, " segments"]]:
    r"""KITTI's relative errors of segments: translation as a share, and rotation in degrees per metre.

    From every tenth pose i, and for each length L, the segment ends at the first pose j whose path from i along the
    reference is longer than L; both errors of :math:`(P_i^{-1} P_j)^{-1} (Q_i^{-1} Q_j)` are divided by L. Their means
    are what KITTI calls t_rel (in per cent) and r_rel.

    Args:
        reference, estimate: poses of the same frames.
        lengths_m: lengths of the segments in metres.
        every: number of poses from one start to the next.

    Returns:
        Errors of all segments; none if the path is shorter than all lengths.

    Raises:
        ValueError: shapes differ.

    Source: A. Geiger et al., "Are we ready for autonomous driving?", CVPR 2012, and the benchmark's definition.

    >>> truth = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])  # 10 m straight on
    >>> segment_errors(truth, 1.02 * truth, lengths_m=[5.0])  # the segment ends at 6 m: 0.12 m / 5 m
    (array([0.024]), array([0.]))
    """
    truth, guess = _matrices(reference, estimate)
    steps = np.linalg.norm(np.diff(truth[:, :-1, -1], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    starts = np.arange(0, len(along), every)
    first, length = (part.ravel() for part in np.meshgrid(starts, np.asarray(lengths_m, float), indexing="ij"))
    last = np.searchsorted(along, along[first] + length, side="right")
    kept = last < len(along)
    first, last, length = first[kept], last[kept], length[kept]
    errors = _between(_between(guess[first], guess[last]), _between(truth[first], truth[last]))
    return np.asarray(np.linalg.norm(errors[:, :-1, -1], axis=1)) / length, _angle_deg(errors) / length


def pooled_errors(
    reference: Float[ndarray, "t r 3"], estimate: Float[ndarray, "t r 3"], spans: Spans
) -> tuple[Float[ndarray, " n"], Float[ndarray, " pairs"], Float[ndarray, " pairs"]]:
    """Aligned and relative errors within a span of each run, of all runs together.

    Args:
        reference, estimate: poses by step and run.
        spans: the first step of each run that counts, and the one after the last.

    Returns:
        The error of each position after its run is aligned by a rigid motion, for runs that do not stand still; the
        error of the motion from each pose to the next; and that of its rotation, in degrees.

    Raises:
        ArgumentError: a position is not finite.

    >>> truth = np.zeros((3, 2, 3))  # the second of two runs stands still
    >>> truth[:, 0, :2] = [[0, 0], [1, 0], [1, 1]]
    >>> aligned, step, _ = pooled_errors(truth, truth + [0.5, 0.0, 0.0], spans=[(0, 3), (0, 3)])
    >>> aligned.round(6), step
    (array([0., 0., 0.]), array([0., 0., 0., 0.]))
    """
    aligned, step, turned = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for run, (first, end) in enumerate(spans):
        truth, guess = reference[first:end, run], estimate[first:end, run]
        if len(truth) == 0:
            continue
        if not np.min([np.ptp(poses[:, :2], axis=0).max() for poses in (truth, guess)]) <= STILL:  # nan fails below
            aligned.append(absolute_errors(truth, guess, alignment="rigid"))
        step.append(relative_errors(truth, guess))
        turned.append(relative_errors(truth, guess, part="rotation_deg"))
    return np.concatenate(aligned), np.concatenate(step), np.concatenate(turned)


def align(
    reference: Float[ndarray, "n k k"], estimate: Float[ndarray, "n k k"], *, scaled: bool
) -> Float[ndarray, "n k k"]:
    r"""Align the estimate by the s, R, t with least :math:`\sum_i \|s R\,t(P_i) + t - t(Q_i)\|^2`, R a rotation.

    Planar poses are rotated within their plane; evo, which aligns in 3D, may also turn them over.

    Args:
        reference, estimate: homogeneous matrices, with 3 rows in the plane and 4 in space.
        scaled: whether s is free; otherwise it is 1.

    Raises:
        ValueError: the positions do not determine the rotation.
        ArgumentError: a pose is not finite.

    >>> truth = np.tile(np.eye(3), (3, 1, 1))
    >>> truth[:, :2, 2] = [[0, 0], [2, 0], [0, 2]]
    >>> halved = truth * [[1, 1, 0.5], [1, 1, 0.5], [1, 1, 1]]
    >>> [np.allclose(align(truth, halved, scaled=scaled), truth) for scaled in (True, False)]
    [True, False]
    """
    for name, poses in (("reference", reference), ("estimate", estimate)):
        if wrong := np.flatnonzero(~np.isfinite(poses).all(axis=(1, 2))).tolist():
            raise ArgumentError(
                f"{name}: pose {wrong[0]}, counted from 0, is not finite ({len(wrong)} of {len(poses):,} are not)",
                "Leave these frames out of both trajectories, or skip the alignment: alignment='none'",
            )
    target, source = reference[:, :-1, -1], estimate[:, :-1, -1]
    middle, centre = target.mean(axis=0), source.mean(axis=0)
    left, values, right = np.linalg.svd((target - middle).T @ (source - centre) / len(target))
    if np.count_nonzero(values > np.finfo(float).eps) < len(middle) - 1:
        where = "in a point" if len(middle) == 2 else "on a line or in a point"
        raise ValueError(f"the positions of a trajectory do not determine its alignment: they lie {where}")
    signs = np.ones(len(middle))
    signs[-1] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = left * signs @ right
    scale = values @ signs / ((source - centre) ** 2).sum(axis=1).mean() if scaled else 1.0
    moved = estimate.copy()
    moved[:, :-1, :-1] = rotation @ estimate[:, :-1, :-1]
    moved[:, :-1, -1] = scale * source @ rotation.T + middle - scale * rotation @ centre
    return moved


def _matrices(reference: Poses, estimate: Poses) -> tuple[Float[ndarray, "n k k"], Float[ndarray, "n k k"]]:
    if reference.shape != estimate.shape or len(reference) == 0:
        raise ValueError(f"need estimates of the same frames, got {reference.shape} and {estimate.shape} poses")
    return _homogeneous(reference), _homogeneous(estimate)


def _homogeneous(poses: Poses) -> Float[ndarray, "n k k"]:
    if poses.ndim == 3:
        return poses.astype(np.float64)
    x, y, heading = poses.T.astype(np.float64)
    cosine, sine, zero, one = np.cos(heading), np.sin(heading), np.zeros(len(x)), np.ones(len(x))
    return np.stack([cosine, -sine, x, sine, cosine, y, zero, zero, one], axis=-1).reshape(-1, 3, 3)


def _between(a: Float[ndarray, "n k k"], b: Float[ndarray, "n k k"]) -> Float[ndarray, "n k k"]:
    """Each pose of b relative to its counterpart in a."""
    back = np.swapaxes(a[:, :-1, :-1], 1, 2)
    out = b.copy()
    out[:, :-1, :-1] = back @ b[:, :-1, :-1]
    out[:, :-1, -1] = (back @ (b[:, :-1, -1:] - a[:, :-1, -1:]))[..., 0]
    return out


def _angle_deg(poses: Float[ndarray, "n k k"]) -> Float[ndarray, " n"]:
    rotations = poses[:, :-1, :-1]
    if rotations.shape[1] == 2:
        return np.asarray(np.degrees(np.abs(np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]))))
    return np.asarray(np.degrees(Rotation.from_matrix(rotations).magnitude())) if len(rotations) else np.zeros(0)
