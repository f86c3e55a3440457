"""The belief of a particle filter: weighted poses, with weights in the log domain."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.shapes import check_shape


@dataclass(frozen=True)
class Belief:
    r"""Weighted particles of r runs, :math:`p(x) \approx \sum_i W_i \, \delta(x - x_i)` with :math:`\sum_i W_i = 1`.

    Attributes:
        poses: x, y in metres and heading in rad.
        log_weights: :math:`\log W`, normalised in each run; -inf marks a particle without weight.

    Example:
        >>> poses = torch.zeros(1, 4, 3, dtype=torch.float64)
        >>> belief = Belief.of(poses, torch.tensor([[3.0, 3.0, 0.0, 0.0]], dtype=torch.float64).log())
        >>> belief.weights.round(decimals=4).tolist(), belief.ess().round(decimals=4).tolist()  # two of four count
        ([[0.5, 0.5, 0.0, 0.0]], [2.0])
    """

    poses: Float64[Tensor, "r p 3"]
    log_weights: Float64[Tensor, "r p"]

    @classmethod
    def of(cls, poses: Float64[Tensor, "r p 3"], log_weights: Float64[Tensor, "r p"]) -> "Belief":
        """A belief from weights that need not be normalised.

        Raises:
            ArgumentError: there is not one weight for each pose, or poses are not x, y and heading.
            ValueError: there is no particle, or a run has no weight above zero or one that is nan or infinite.
        """
        _check_poses(poses)
        check_shape("log_weights", log_weights, *poses.shape[:2])
        total = log_weights.logsumexp(1, keepdim=True)
        if not bool(total.isfinite().all()):
            raise ValueError(
                "each run needs a particle with a weight above zero, and no weight that is nan or infinite"
            )
        return cls(poses, log_weights - total)

    @classmethod
    def uniform(cls, poses: Float64[Tensor, "r p 3"]) -> "Belief":
        """A belief in which all particles have the same weight.

        Raises:
            ArgumentError: poses are not x, y and heading.
            ValueError: there is no particle.
        """
        _check_poses(poses)
        return cls(poses, poses.new_full(poses.shape[:2], -math.log(poses.shape[1])))

    @property
    def weights(self) -> Float64[Tensor, "r p"]:
        """The weights W, which sum to one in each run."""
        return self.log_weights.exp()

    def ess(self) -> Float64[Tensor, "r"]:
        r"""Effective sample size :math:`1 / \sum_i W_i^2`, from 1 to p (Kong, Liu & Wong, JASA 1994)."""
        return torch.exp(-(2 * self.log_weights).logsumexp(1))


def _check_poses(poses: Tensor) -> None:
    check_shape("poses", poses, "runs", "particles", 3)
    if poses.shape[1] == 0:
        raise ValueError("a belief needs at least one particle")


def picked(poses: Float64[Tensor, "r p 3"], rows: Int64[Tensor, "r k"]) -> Float64[Tensor, "r k 3"]:
    """Some of each run's poses.

    >>> picked(torch.arange(6).view(1, 2, 3), torch.tensor([[1, 0, 1]])).tolist()
    [[[3, 4, 5], [0, 1, 2], [3, 4, 5]]]
    """
    return poses.gather(1, rows[..., None].expand(-1, -1, 3))
