r"""One camera from all evidence at once: lines, a network, a prior on people's cameras, and whatever else is known.

The estimate is the camera of least cost (:mod:`~sextant.baselines.calibration.joint_problem`) over many starts: frames
of vanishing points, and the believed cameras with the headings that suit the lines best. The curvature at the optimum
gives a covariance, to which other modes contribute by their probability relative to the best.

Sources: as :mod:`~sextant.baselines.calibration.vanishing_points`; K. L. Lange, R. J. A. Little, J. M. G. Taylor,
"Robust statistical modeling using the t distribution", JASA 1989, for the losses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray

from sextant.baselines.calibration.joint_problem import K1_HAT, LOG_FOCAL, ROLL, TILT, JointProblem, Mode
from sextant.baselines.calibration.line_evidence import LineEvidence
from sextant.baselines.calibration.robust_fit import HIGH, LOW
from sextant.baselines.calibration.starts import joint_starts
from sextant.baselines.calibration.terms import Term

#: number of rough fits that are refined; distance to its bound below which a number counts as lying there
FINAL, AT_END = 2, 1e-3


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """A photo's camera from all evidence.

    Attributes:
        vector: tilt, roll, log focal and k1_hat of the best mode, in image heights.
        covariance: covariance of these, other modes included.
        support: how many long segments point to each axis, right, down and forward.
        rivals: probability of all modes but the best.
        ends: which of tilt, roll, focal length and distortion lie at an end of the range searched.
    """

    vector: Float64[ndarray, "4"]
    covariance: Float64[ndarray, "4 4"]
    support: Int[ndarray, "3"]
    rivals: float
    ends: tuple[str, ...]


def joint_estimate(lines: LineEvidence, beliefs: Sequence[Term], *, seed: int = 0) -> JointEstimate:
    """The camera of a photo from its lines and everything else that is known.

    Args:
        lines: lines of the photo.
        beliefs: a network's, priors, and whatever else is known; in heights of the photo.
        seed: seed of the vanishing points' hypotheses; the same evidence and seed give the same camera.

    Raises:
        ValueError: there is no belief, so that nothing bounds the camera.

    Example:
        >>> from sextant.baselines.calibration import CameraBelief, FocalBelief
        >>> lines = LineEvidence.of(np.zeros((64, 64, 3), np.uint8))  # none
        >>> network = CameraBelief(tilt=0.1, roll=0.0, focal=1.0, k1_hat=0.0, sigma=(0.1, 0.1, 0.2, 0.1))
        >>> found = joint_estimate(lines, [network, FocalBelief(1.2, sigma=0.01)])  # which is surer of the focal length
        >>> round(float(found.vector[0]), 2), round(float(np.exp(found.vector[2])), 2)
        (0.1, 1.2)
    """
    if not beliefs:
        raise ValueError("need at least one belief: lines alone do not bound every camera")
    problem = JointProblem(lines, beliefs)
    rough = sorted((problem.rough(start) for start in joint_starts(problem, seed)), key=lambda mode: mode.cost)
    modes = sorted((problem.fine(mode.vector) for mode in _apart(rough)[:FINAL]), key=lambda mode: mode.cost)
    best, known = modes[0], [TILT, ROLL, LOG_FOCAL, K1_HAT]
    modes = _apart(modes)
    weights = np.exp(best.cost - np.array([mode.cost for mode in modes]))
    weights /= weights.sum()
    covariance = np.zeros((4, 4))
    for weight, mode in zip(weights, modes, strict=True):
        off = (mode.vector - best.vector)[known]
        covariance += weight * (mode.covariance[np.ix_(known, known)] + np.outer(off, off))
    at = [np.minimum(best.vector - LOW, HIGH - best.vector)[index] < AT_END for index in known]
    ends = tuple(name for name, end in zip(("tilt", "roll", "focal length", "distortion"), at, strict=True) if end)
    return JointEstimate(best.vector[known], covariance, best.support, float(1 - weights[0]), ends)


def _apart(modes: Sequence[Mode]) -> list[Mode]:
    """The modes without those that are the same camera as an earlier one."""
    kept: list[Mode] = []
    for mode in modes:
        off = [np.abs(mode.vector - other.vector)[[TILT, ROLL, LOG_FOCAL]].max() for other in kept]
        if min(off, default=1.0) > 0.02:
            kept.append(mode)
    return kept
