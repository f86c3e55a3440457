r"""The cost of a camera given all evidence of a photo, and its minima.

The cost is half the sum of all terms' robust losses (:mod:`~sextant.baselines.calibration.terms`). Each segment of a
picture belongs to the nearest of three orthogonal axes, with a Cauchy loss, or to none, at the cost of a segment at the
threshold, so that modes that explain different segments have comparable costs.

Segments are weighted by the share of their length that some frame explains beyond chance: where that is small, the
scene is not a world of boxes. On crops of panoramas, the errors of frames are four times those from the curvature where
a share of 0.2 is explained, twice at 0.4, and equal from 0.65 on. In the curvature, the weight of segments is therefore
the cube of that in the cost.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray

from sextant.baselines.calibration.line_evidence import LineEvidence
from sextant.baselines.calibration.line_segments import LONG, segment_lengths
from sextant.baselines.calibration.manhattan import (
    EFFECTIVE_SEGMENTS,
    FIRST_ROUND,
    OUTLIER,
    THRESHOLD,
    AlignedSegments,
    nearest_axis,
)
from sextant.baselines.calibration.robust_fit import HIGH, LOW, RobustFit
from sextant.baselines.calibration.terms import StraightChains, Term

#: share of explained length from which segments count in full, and the least weight that they have
FRAME, LEAST = 0.7, 0.05
TILT, ROLL, HEADING, LOG_FOCAL, K1_HAT = range(5)


@dataclass(frozen=True, eq=False)
class Mode:
    """A camera at a minimum of the cost.

    Attributes:
        vector: tilt, roll, heading, log focal, k1_hat, in image heights.
        covariance: covariance of these, from the curvature.
        cost: negative log posterior up to a constant.
        support: number of long segments along each of the axes.
    """

    vector: Float64[ndarray, "5"]
    covariance: Float64[ndarray, "5 5"]
    cost: float
    support: Int[ndarray, "3"]


def _trust(explained: float) -> float:
    """The weight of a photo's segments: the root of the share of their length that some frame explains.

    Of six curves, this one has the smallest errors over the photos of ``benchmarks.joint_intervals``, whichever of
    their sets is left out. Segments that no frame explains get almost no weight, so the network determines the camera.
    """
    return min(max(math.sqrt(max(explained, 0.0) / FRAME), LEAST), 1.0)


class JointProblem:
    """The cost of cameras for one photo.

    Args:
        lines: lines of the photo.
        beliefs: all other evidence about its camera.
    """

    def __init__(self, lines: LineEvidence, beliefs: Sequence[Term]):
        self.lines, self.beliefs = lines, tuple(beliefs)
        self.trust = _trust(lines.explained)
        self.share = min(1.0, EFFECTIVE_SEGMENTS / max(len(lines.segments), 1)) * self.trust
        self.chains = [StraightChains(lines.chains, lines.shorter)] if len(lines.chains) else []

    def belief_cost(self, vectors: Float64[ndarray, "b 5"]) -> Float64[ndarray, "b"]:
        """The cost of everything but the lines."""
        return np.asarray(sum(term.cost(vectors) for term in self.beliefs) + np.zeros(len(vectors)))

    def rough(self, start: Float64[ndarray, "5"]) -> Mode:
        """The minimum near ``start`` at its distortion, with segments assigned once by a wide threshold."""
        return self._fit(start, FIRST_ROUND, np.arange(4), self.beliefs)

    def fine(self, start: Float64[ndarray, "5"]) -> Mode:
        """The minimum near ``start``, with segments assigned twice."""
        return self._fit(start, (THRESHOLD, THRESHOLD), np.arange(5), (*self.chains, *self.beliefs))

    def _fit(
        self,
        start: Float64[ndarray, "5"],
        thresholds: tuple[float, ...],
        free: Int[ndarray, "k"],
        terms: Sequence[Term],
    ) -> Mode:
        vector = np.clip(start, LOW + 1e-6, HIGH - 1e-6)
        segments, outliers, support = self.lines.segments, 0, np.zeros(3, int)
        for threshold in thresholds:
            stacked = terms
            if len(segments):
                axis, near = nearest_axis(vector, segments, threshold)
                outliers = int((~near).sum())
                support = np.bincount(axis[near & (segment_lengths(segments) > LONG * self.lines.shorter)], minlength=3)
                aligned = AlignedSegments(segments[near], axis[near], self.share, self.trust**2, self.lines.shorter)
                stacked = [aligned, *terms]
            fit = RobustFit(stacked, free, vector, tolerance=1e-5, evaluations=15)
            vector = fit.solve(vector)
        information = 1e-9 * np.eye(5) + fit.information(vector)
        information[HEADING, HEADING] += 1e-4  # the heading may be undetermined
        cost = fit.cost(vector) + OUTLIER * self.share * outliers
        return Mode(vector, np.linalg.inv(information), cost, support)
