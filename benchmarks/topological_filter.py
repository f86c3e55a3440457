r"""A topological Bayes filter over the images of a map: the forward pass of a hidden Markov model.

The state is an image i of the map. With the motion u since the previous step, an image leads to those near
:math:`x_i \circ u`; with probability :math:`\epsilon` the robot was carried to any image:

.. math:: \bar b_t(j) = \frac\epsilon n + (1 - \epsilon) \sum_i b_{t-1}(i)\, p(j \mid i, u), \qquad
   p(j \mid i, u) \propto e^{-\frac12 d^2(x_i \circ u,\; x_j)}, \qquad
   d^2(x, y) = \frac{\|x_{xy} - y_{xy}\|^2}{\sigma^2} + \frac{2(1 - \cos(x_\theta - y_\theta))}{\rho^2}.

A query image at descriptor distance :math:`d_j` from image j of the map weights them by

.. math:: b_t(j) \propto \bar b_t(j)\, e^{-\lambda d_j}, \qquad \lambda = \frac{\log\delta}{q_{97.5} - q_{2.5}},

with the quantiles of the distances from a drive's first image to the whole map: one of the most similar images is
:math:`\delta` times as likely as one of the least similar. :math:`\sigma` is half of the map's spacing, with which
motions of a third of a spacing still accumulate, but 6 % too short. :math:`\rho` is half of the turn between images at
one place. A step costs O(n²).

Sources: M. Xu, N. Sünderhauf, M. Milford, "Probabilistic Visual Place Recognition for Hierarchical Localization", RA-L
2021, for the likelihood and :math:`\delta = 5`; odometry in the transition as in M. Xu, T. Fischer, N. Sünderhauf,
M. Milford, "Probabilistic Appearance-Invariant Topometric Localization with New Place Awareness", RA-L 2021.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose
from sextant.localization.map_support import heading_reach, map_spacing

#: range of distances below which they differ by rounding only
LEAST_RANGE = 1e-12
#: distance in standard deviations beyond which all images are treated alike, whatever the motion
FURTHEST = 1e150


@dataclass(frozen=True)
class TopologicalFilter:
    r"""The steps of the filter; the belief is passed to each step.

    Attributes:
        poses: poses of the map's images: x, y in any unit and heading in rad.
        position_sigma: :math:`\sigma`, in the unit of positions.
        heading_sigma: :math:`\rho` in rad.
        jump: :math:`\epsilon` in (0, 1).
    """

    poses: Float64[Tensor, "n 3"]
    position_sigma: float
    heading_sigma: float
    jump: float = 1e-3

    @classmethod
    def of(cls, poses: Float64[Tensor, "n 3"], jump: float = 1e-3) -> Self:
        """A filter with scales from the map's own spacing."""
        return cls(poses, map_spacing(poses) / 2, heading_reach(poses), jump)

    def uniform(self) -> Float64[Tensor, " n"]:
        """The belief before the first step."""
        return torch.full((len(self.poses),), 1 / len(self.poses), dtype=torch.float64)

    def moved(self, belief: Float64[Tensor, " n"], motion: Sequence[float]) -> Float64[Tensor, " n"]:
        r"""The belief :math:`\bar b_t` after a motion, before the observation.

        Args:
            belief: belief before the motion, which sums to one.
            motion: dx, dy in the unit of the map and dtheta in rad, in the robot's frame before the motion.
        """
        ahead = self._features(se2_compose(self.poses, torch.as_tensor(motion, dtype=torch.float64)))
        apart = torch.cdist(ahead, self._features(self.poses), compute_mode="donot_use_mm_for_euclid_dist")
        apart = apart.nan_to_num(FURTHEST).clamp(max=FURTHEST)
        return self.jump / len(belief) + (1 - self.jump) * (belief @ torch.softmax(-0.5 * apart.square(), dim=1))

    def step(
        self, belief: Float64[Tensor, " n"], motion: Sequence[float], distances: Float64[Tensor, " n"], rate: float
    ) -> Float64[Tensor, " n"]:
        r"""The belief :math:`b_t` after a motion and an observation.

        Args:
            belief, motion: as for :meth:`moved`.
            distances: distances of the image's descriptor from those of the map, in the map's order.
            rate: :math:`\lambda`, from :func:`likelihood_rate` of the first image.
        """
        return torch.softmax(self.moved(belief, motion).log() - rate * (distances - distances.min()), dim=0)

    def _features(self, poses: Tensor) -> Tensor:
        turned = torch.stack([poses[:, 2].cos(), poses[:, 2].sin()], dim=1) / self.heading_sigma
        return torch.cat([poses[:, :2] / self.position_sigma, turned], dim=1)


def likelihood_rate(distances: Float64[Tensor, " n"], odds: float = 5.0) -> float:
    r"""The rate :math:`\lambda`, from the distances of an image to all of a map; 0 if they are all equal.

    Args:
        distances: distances of descriptors, at least 0.
        odds: :math:`\delta`, above 1.
    """
    low, high = torch.quantile(distances, distances.new_tensor([0.025, 0.975])).tolist()
    return math.log(odds) / (high - low) if high - low > LEAST_RANGE else 0.0
