r"""Smoothing: past poses given all later observations. Beliefs are reweighted from the last to the first.

.. math:: W_{t|T}^i = W_t^i \sum_j W_{t+1|T}^j \, \frac{f(x_{t+1}^j \mid x_t^i)}{\sum_k W_t^k f(x_{t+1}^j \mid x_t^k)}

(forward filtering, backward smoothing: Doucet, Godsill & Andrieu, "On Sequential Monte Carlo Sampling Methods for
Bayesian Filtering", 2000, section 5). The motion of a robot in its own frame has the same distribution wherever it is,
so f is the normal density with the mean and covariance of draws of the motion. A particle that a recovery placed
elsewhere descends from no particle. Beyond six standard deviations f is therefore constant and does not constrain the
previous pose.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_between, wrap_angle
from sextant.localization.belief import Belief
from sextant.localization.motion import MotionModel
from sextant.reporter import Advance
from sextant.shapes import check_shape

#: number of draws of a motion, from which its mean and covariance are estimated
DRAWS = 4096
#: standard deviations of a motion without noise, in the map's unit and rad
LEAST = (1e-3, 1e-3, 1e-3)
#: log density relative to its peak below which a motion does not explain a particle: six standard deviations
ELSEWHERE = -18.0
#: number of particles after a motion that are compared with all before it at a time
CHUNK = 256


@torch.no_grad()
def smoothed(
    beliefs: Sequence[Belief],
    motions: Sequence[Float64[Tensor, "r 3"]],
    model: MotionModel | Sequence[MotionModel],
    generator: torch.Generator,
    *,
    progress: Advance = lambda done, total: None,
) -> list[Belief]:
    """The beliefs of a drive, each given all observations up to its end.

    Args:
        beliefs: beliefs of r runs after each step of the filter.
        motions: motions between them, in the robot's frame, nan where unknown; one fewer than there are beliefs.
        model: motion model of all these motions, or one for each.
        generator: generator of random numbers.
        progress: called with the number of beliefs smoothed and of all.

    Returns:
        The same particles with new weights; the last belief is unchanged.

    Raises:
        ArgumentError: there is not one motion for each run.
        ValueError: the number of motions or models does not fit the number of beliefs.

    Example:
        >>> from sextant.localization.motion import ExponentialMotion
        >>> start = Belief.uniform(torch.tensor([[[0.0, 0, 0], [9.0, 0, 0]]], dtype=torch.float64))
        >>> end = Belief.uniform(torch.tensor([[[1.0, 0, 0]]], dtype=torch.float64))  # one metre ahead of the first
        >>> motion, draws = torch.tensor([[1.0, 0, 0]], dtype=torch.float64), torch.Generator()
        >>> smoothed([start, end], [motion], ExponentialMotion(), draws)[0].weights.round(decimals=2).tolist()
        [[1.0, 0.0]]
    """
    if len(motions) != len(beliefs) - 1:
        raise ValueError(f"need one motion fewer than beliefs; got {len(motions)} motions and {len(beliefs)} beliefs")
    for motion in motions:
        check_shape("motion", motion, len(beliefs[-1].poses), 3)
    models = [model] * len(motions) if isinstance(model, MotionModel) else list(model)
    found = [beliefs[-1]]
    for belief, motion, moves in zip(reversed(beliefs[:-1]), reversed(motions), reversed(models), strict=True):
        increments = moves.sample(belief.poses.new_zeros(len(motion), DRAWS, 3), motion, generator)
        later = found[-1]
        rows = [
            _reweighed(belief.poses[run], belief.log_weights[run], later.poses[run], later.log_weights[run], drawn)
            for run, drawn in enumerate(increments)
        ]
        found.append(Belief.of(belief.poses, torch.stack(rows)))
        progress(len(found), len(beliefs))
    return found[::-1]


def _reweighed(
    poses: Float64[Tensor, "p 3"],
    log_weights: Float64[Tensor, "p"],
    later: Float64[Tensor, "q 3"],
    later_log_weights: Float64[Tensor, "q"],
    increments: Float64[Tensor, "d 3"],
) -> Float64[Tensor, "p"]:
    """Log weights of the particles of a run, given those of the next step."""
    first = increments[:1]
    off = _less(increments, first)
    mean = first + off.mean(0)
    factor = torch.linalg.cholesky(torch.cov(off.T) + torch.diag(poses.new_tensor(LEAST) ** 2))
    gathered = torch.full_like(log_weights, -torch.inf)
    for some, weights in zip(later.split(CHUNK), later_log_weights.split(CHUNK), strict=True):
        moved = _less(se2_between(poses[:, None], some[None]), mean)
        white = torch.linalg.solve_triangular(factor, moved.reshape(-1, 3).T, upper=False)
        log_f = torch.logaddexp(-0.5 * white.square().sum(0), white.new_tensor(ELSEWHERE)).reshape(moved.shape[:2])
        behind = torch.logsumexp(log_weights[:, None] + log_f, 0)
        gathered = torch.logaddexp(gathered, torch.logsumexp(weights + log_f - behind, 1))
    return log_weights + gathered


def _less(motions: Float64[Tensor, "*n 3"], mean: Float64[Tensor, "1 3"]) -> Float64[Tensor, "*n 3"]:
    """Differences of motions, with headings by the shorter way."""
    off = motions - mean
    return torch.cat([off[..., :2], wrap_angle(off[..., 2:])], dim=-1)
