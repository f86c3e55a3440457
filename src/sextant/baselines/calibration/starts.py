"""Where the search for a photo's camera starts: frames of vanishing points, and believed cameras."""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.baselines.calibration.estimate import CameraPrior
from sextant.baselines.calibration.joint_problem import HEADING, K1_HAT, LOG_FOCAL, OUTLIER, JointProblem
from sextant.baselines.calibration.lens import apparent_k2, undistort_points
from sextant.baselines.calibration.manhattan import camera_axes, msac_cost
from sextant.baselines.calibration.terms import CameraBelief, GravityBelief, PhotoPrior
from sextant.baselines.calibration.vanishing_points import FEWEST, SCORED, hypotheses, upright

#: headings of a believed camera that are tried: a frame repeats after a right angle
HEADINGS = np.radians(np.arange(-45, 45, 3.0))
#: number of frames that are followed; weight of a belief while vectors are as rough as four segments make them
FOLLOWED, ROUGHLY = 6, 0.3
#: standard deviation of the log focal length of frames where it is unknown, and up to which it counts as known
FOCALS, KNOWN_FOCAL = 0.35, 0.06
#: distance in tilt, roll, heading or log focal from which two starts are distinct
APART = 0.1


def joint_starts(problem: JointProblem, seed: int) -> list[Float64[ndarray, "5"]]:
    """Cameras to start from; each believed one with its best heading is always among them."""
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
    """Spread of the log focal lengths of frames, and k1_hat; a known lens is given to all believed cameras.

    Frames are then sought behind that lens: any other costs more than all lines could save.
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
    """The cameras that beliefs name as such."""
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
