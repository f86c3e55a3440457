r"""The density of poses that a filter predicts, before it observes.

With particles :math:`(x_j, W_j)` before the motion u, and the map's prior g of
:class:`~sextant.localization.map_support.MapSupport`, which is 1 without one,

.. math:: p(x \mid z_{1:t-1}) = \sum_j W_j\, f(x \mid x_j, u) \, \frac{g(x)}{g(x_j)}.

For :class:`~sextant.localization.motion.ExponentialMotion`, :math:`x = x_j \circ u \circ \exp(\epsilon)`, it is
exact: f is the normal density of :math:`\epsilon = \log((x_j \circ u)^{-1} x)` over the determinant of the derivative
of the exponential, :math:`(\sin(\omega/2) / (\omega/2))^2` at the turn :math:`\omega` of :math:`\epsilon`.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose, wrap_angle
from sextant.localization.belief import Belief
from sextant.localization.map_support import MapSupport
from sextant.localization.motion import ExponentialMotion, MotionModel

#: pairs of a particle and a pose whose densities are computed at a time, which bounds the memory
PAIRS = 2_000_000


@dataclass(frozen=True)
class Predicted:
    """What a filter predicts of r runs.

    Attributes:
        before: particles before the motion.
        model: the motion model.
        motion: of each run, nan where it is unknown.
        support: the filter's, or None.

    Example:
        >>> at_zero = Belief.uniform(torch.zeros(1, 1, 3, dtype=torch.float64))
        >>> metre = torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64)
        >>> predicted = Predicted(at_zero, ExponentialMotion((0.1, 0.1, 0.1)), metre)
        >>> there = torch.tensor([[[1.0, 0.0, 0.0], [1.1, 0.0, 0.0]]], dtype=torch.float64)
        >>> density = predicted.log_density(there)
        >>> round(float(density[0, 0] - density[0, 1]), 3)  # a standard deviation beside the peak
        0.5
    """

    before: Belief
    model: MotionModel
    motion: Float64[Tensor, "r 3"]
    support: MapSupport | None = None

    @property
    def known(self) -> Bool[Tensor, "r"]:
        """Whether the motion of each run has a density: the model is exponential, with noise in every coordinate."""
        if not isinstance(self.model, ExponentialMotion):
            return torch.zeros(len(self.motion), dtype=torch.bool, device=self.motion.device)
        return (self._sigmas > 0).all(1)

    @property
    def _sigmas(self) -> Float64[Tensor, "r 3"]:
        assert isinstance(self.model, ExponentialMotion)
        moved = self.motion.isfinite().all(1)
        unknown = self.motion.new_tensor(self.model.if_unknown()).expand_as(self.motion)
        return torch.where(moved[:, None], self.model.sigmas(self._motion), unknown)

    @property
    def _motion(self) -> Float64[Tensor, "r 3"]:
        return torch.where(self.motion.isfinite().all(1, keepdim=True), self.motion, 0.0)

    def log_density(self, poses: Float64[Tensor, "r m 3"]) -> Float64[Tensor, "r m"]:
        """The log density of each run's poses; -inf in runs whose motion has none."""
        known = self.known
        if not bool(known.any()):
            return torch.full_like(poses[..., 0], -torch.inf)
        ahead = se2_compose(self.before.poses, self._motion[:, None])
        weights, sigmas = self.before.log_weights, self._sigmas
        if self.support is not None:
            weights = weights - self.support.log_prior(self.before.poses)
        rows = []
        for run in range(len(poses)):
            if not known[run]:
                rows.append(torch.full_like(poses[run, :, 0], -torch.inf))
                continue
            size = max(1, PAIRS // ahead.shape[1])
            rows.append(torch.cat([_summed(ahead[run], weights[run], p, sigmas[run]) for p in poses[run].split(size)]))
        found = torch.stack(rows)
        return found if self.support is None else found + self.support.log_prior(poses)


def _summed(
    ahead: Float64[Tensor, "p 3"], weights: Float64[Tensor, "p"], poses: Float64[Tensor, "m 3"], sigmas: Tensor
) -> Float64[Tensor, "m"]:
    """Log densities of some poses of a run.

    The along and across parts of epsilon are the displacement in axes half way between both headings, over the sinc of
    half the turn; a heading that is wrapped turns them around, which their squares do not see.
    """
    turn = wrap_angle(poses[:, None, 2] - ahead[:, 2])
    stretched = torch.sinc(turn / (2 * math.pi)).square()
    here, there = poses[:, None, 2] / 2, ahead[:, 2] / 2
    cosine = here.cos() * there.cos() - here.sin() * there.sin()
    sine = here.sin() * there.cos() + here.cos() * there.sin()
    x, y = poses[:, None, 0] - ahead[:, 0], poses[:, None, 1] - ahead[:, 1]
    along, across, turned = (1 / sigmas.square()).tolist()
    squared = along * (x * cosine + y * sine).square() + across * (y * cosine - x * sine).square()
    log_density = -0.5 * (squared / stretched + turned * turn.square()) - stretched.log()
    constant = float(sigmas.log().sum()) + 1.5 * math.log(2 * math.pi)
    return torch.logsumexp(weights + log_density, 1) - constant
