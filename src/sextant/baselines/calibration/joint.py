r"""One camera from all evidence: lines, a network, a prior on typical cameras, and any other beliefs.

The estimate is the camera of least cost (:mod:`~sextant.baselines.calibration.joint_problem`) over many starts: frames
of vanishing points, and the believed cameras with the headings that fit the lines best. The covariance about the best
mode sums each mode's inverse curvature and squared offset, weighted by the mode's probability.

Sources: as :mod:`~sextant.baselines.calibration.vanishing_points`; K. L. Lange, R. J. A. Little, J. M. G. Taylor,
"Robust statistical modeling using the t distribution", JASA 1989, for the losses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray

from sextant.baselines.calibration.estimate import CameraPrior
from sextant.baselines.calibration.joint_problem import (
    HEADING,
    K1_HAT,
    LOG_FOCAL,
    ROLL,
    TILT,
    JointProblem,
    Mode,
)
from sextant.baselines.calibration.lens import apparent_k2, undistort_points
from sextant.baselines.calibration.line_evidence import LineEvidence
from sextant.baselines.calibration.manhattan import OUTLIER, camera_axes, msac_cost
from sextant.baselines.calibration.robust_fit import HIGH, LOW
from sextant.baselines.calibration.terms import CameraBelief, GravityBelief, PhotoPrior, Term
from sextant.baselines.calibration.vanishing_points import FEWEST, SCORED, hypotheses, upright

#: headings tried for a believed camera: frames repeat after a right angle
HEADINGS = np.radians(np.arange(-45, 45, 3.0))
#: number of starts kept; weight of the beliefs when ranking starts, which are as rough as frames of four segments
FOLLOWED, ROUGHLY = 6, 0.3
#: standard deviation of the log focal length of frames if it is unknown, and the largest with which it counts as known
FOCALS, KNOWN_FOCAL = 0.35, 0.06
#: distance in tilt, roll, heading or log focal from which two starts are distinct
APART = 0.1


def joint_starts(problem: JointProblem, seed: int) -> list[Float64[ndarray, "5"]]:
    """Starting cameras, always including each believed one with its best heading."""
    believed = _believed(problem)
    segments, (spread, k1_hat) = problem.lines.segments, _known_lens(problem, believed)
    if len(segments) < FEWEST:
        return believed
    focal = float(np.exp(believed[0][LOG_FOCAL]))
    lens = CameraPrior(focal=focal, sigma=(0.3, 0.15, spread, 0.3))
    straight = undistort_points(segments, k1_hat, apparent_k2(k1_hat, focal))
    scored = straight[:SCORED].astype(np.float32)
    nats = OUTLIER * problem.share * len(segments)  # cost of a picture none of whose segments fit an axis

    def lines_cost(axes: ndarray, focals: ndarray) -> ndarray:
        share = msac_cost(axes.astype(np.float32), focals.astype(np.float32), scored)
        return np.asarray(nats * np.nan_to_num(share, nan=np.inf))

    frames, focals = hypotheses(straight, lens, np.random.default_rng(seed))
    vectors = upright(frames, focals, k1_hat).reshape(-1, 5)
    legal = np.isfinite(vectors).all(axis=1)
    costs = np.tile(lines_cost(frames, focals), 3)[legal]
    vectors = vectors[legal]
    turned = [_turned(vector) for vector in believed]
    headed = [lines_cost(camera_axes(each), np.exp(each[:, 3])) for each in turned]
    vectors = np.concatenate([vectors, *turned])
    costs = np.concatenate([costs, *headed]) + ROUGHLY * problem.belief_cost(vectors)
    starts = _first_apart(vectors, costs)
    return starts + [each[cost.argmin()] for each, cost in zip(turned, headed, strict=True)]


def _known_lens(problem: JointProblem, believed: list[Float64[ndarray, "5"]]) -> tuple[float, float]:
    """Spread of the log focal lengths of frames, and k1_hat; a known lens is assigned to all believed cameras.

    Frames are then searched only for that lens: any other costs more than all lines can save.
    """
    named = [term.lens for term in problem.beliefs if term.lens]
    log_focal, sigma, k1_hat = min(named, key=lambda lens: lens[1], default=(0.0, np.inf, None))
    k1_hat = problem.lines.k1_hat if k1_hat is None or sigma > KNOWN_FOCAL else k1_hat
    if sigma > KNOWN_FOCAL:
        return FOCALS, k1_hat
    for vector in believed:
        vector[[LOG_FOCAL, K1_HAT]] = log_focal, k1_hat
    return sigma, k1_hat


def _believed(problem: JointProblem) -> list[Float64[ndarray, "5"]]:
    """The cameras given by the beliefs."""
    longer, k1_hat = problem.lines.longer, problem.lines.k1_hat
    found = []
    for term in problem.beliefs:
        if isinstance(term, CameraBelief):
            found.append([term.tilt, term.roll, 0.0, np.log(term.focal * term.zoom), k1_hat])
        elif isinstance(term, PhotoPrior):
            found.append([0.0, 0.0, 0.0, np.log(term.focal * longer), k1_hat])
    for pose in (term.pose for term in problem.beliefs if isinstance(term, GravityBelief)):
        found = [[*pose, *vector[2:]] for vector in found]
    return [np.array(vector) for vector in found or [[0.0, 0.0, 0.0, np.log(0.95 * longer), k1_hat]]]


def _turned(vector: Float64[ndarray, "5"]) -> Float64[ndarray, "h 5"]:
    turned = np.repeat(vector[None], len(HEADINGS), axis=0)
    turned[:, HEADING] = HEADINGS
    return turned


def _first_apart(vectors: Float64[ndarray, "n 5"], costs: Float64[ndarray, "n"]) -> list[Float64[ndarray, "5"]]:
    """The cheapest vectors that are distinct."""
    kept: list[ndarray] = []
    for index in np.argsort(costs, kind="stable")[:80]:
        if not np.isfinite(costs[index]) or len(kept) == FOLLOWED:
            break
        if all(np.abs(vectors[index] - other)[:K1_HAT].max() > APART for other in kept):
            kept.append(vectors[index])
    return kept


#: number of rough fits that are refined; distance to its bound below which a number counts as lying there
FINAL, AT_END = 2, 1e-3


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """A photo's camera from all evidence.

    Attributes:
        vector: tilt, roll, log focal and k1_hat of the best mode, in image heights.
        covariance: covariance of these, other modes included.
        support: number of long segments along each axis: right, down and forward.
        rivals: probability of all modes but the best.
        ends: which of tilt, roll, focal length and distortion lie at an end of the range searched.
    """

    vector: Float64[ndarray, "4"]
    covariance: Float64[ndarray, "4 4"]
    support: Int[ndarray, "3"]
    rivals: float
    ends: tuple[str, ...]


def joint_estimate(lines: LineEvidence, beliefs: Sequence[Term], *, seed: int = 0) -> JointEstimate:
    """The camera of a photo from its lines and all other evidence.

    Args:
        lines: lines of the photo.
        beliefs: beliefs of a network, priors and other evidence, in heights of the photo.
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
