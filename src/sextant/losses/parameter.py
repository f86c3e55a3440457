r"""Losses on the parameters themselves: :math:`\frac14 \sum_a h(s_a(\hat a - a))` over the four numbers.

The losses differ in the scale :math:`s_a`: in ``raw`` units (degrees, and the focal length in pixels of an image 224
high) the large numbers drown the small ones; ``range`` divides by the width of each number's range; ``natural`` takes
radians and image heights as they are.

``learned`` starts from ``range`` and learns a variance :math:`\sigma_a^2` of each number with the network, so that no
weight is set by hand: :math:`\frac14 \sum_a \big(e^{-v_a} h(s_a(\hat a - a)) + v_a\big)` with :math:`v_a = \ln
\sigma_a^2`, twice the negative log-likelihood of normal errors but for a constant. It can be negative.

Source of the learned variances: A. Kendall, Y. Gal, R. Cipolla, "Multi-task learning using uncertainty to weigh losses
for scene geometry and semantics", CVPR 2018, section 3.2.
"""

import math
from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.geometry import ParameterSpace
from sextant.losses.camera_loss import CameraLoss, at_least_single

Units = Literal["raw", "range", "natural", "learned"]
Penalty = Literal["l2", "huber"]
RAW_HEIGHT_PX = 224.0
DEGREES = 180 / torch.pi
#: log variances move so many times as far in a step as weights do, so that some hundred steps suffice
PACE = 10.0
#: variance of a number that is drawn evenly from its range, where learned variances start
EVEN = 1 / 12
#: raw units per natural unit
RAW = {"focal": RAW_HEIGHT_PX, "k1": 1.0, "k1_hat": 1.0, "rho": RAW_HEIGHT_PX, "tau": RAW_HEIGHT_PX}


class ParameterLoss(CameraLoss):
    r"""Squared or Huber penalty on the errors of the four numbers.

    ``l2``: :math:`h(e) = e^2`. ``huber``: :math:`h(e) = \tfrac12 e^2` for :math:`|e| \le \delta`, else
    :math:`\delta(|e| - \tfrac12 \delta)`, twice over, so that it equals ``l2`` near 0.

    Args:
        space: the parameterization and its ranges.
        units: ``raw``, ``range``, ``natural`` or ``learned``.
        penalty: ``l2`` or ``huber``.
        delta: where Huber's penalty becomes linear, in these units.

    Raises:
        UserError: units or penalty are unknown, or ``delta`` is not positive.

    Example:
        >>> from sextant.geometry import Parameterization
        >>> low, high = torch.tensor([-1.0, -1.0, 1.0, -1.0]), torch.tensor([1.0, 1.0, 3.0, 1.0])
        >>> loss = ParameterLoss(ParameterSpace(Parameterization("direct"), low, high))
        >>> truth, tilted = torch.tensor([[0.0, 0.0, 2.0, 0.0]]), torch.tensor([[0.2, 0.0, 2.0, 0.0]])
        >>> loss(tilted, truth, torch.ones(1))  # off by a tenth of the range: 0.1² / 4
        tensor([0.0025])
    """

    scale: Tensor

    def __init__(self, space: ParameterSpace, *, units: Units = "range", penalty: Penalty = "l2", delta: float = 1.0):
        super().__init__(space)
        if units not in get_args(Units):
            raise ArgumentError(f"units={units!r} must be one of {', '.join(get_args(Units))}", "units=range")
        if penalty not in get_args(Penalty):
            raise ArgumentError(f"penalty={penalty!r} must be one of {', '.join(get_args(Penalty))}", "penalty=l2")
        if not delta > 0:
            raise ArgumentError(f"delta={delta} must be above 0", "For example delta=1.0")
        self.penalty, self.delta = penalty, delta
        self.paced: nn.Parameter | None = None
        if units == "learned":
            self.paced = nn.Parameter(torch.full((4,), math.log(EVEN) / PACE))
        if units in ("range", "learned"):
            scale = 1 / (space.high - space.low)
        elif units == "raw":
            scale = torch.tensor([RAW.get(name, DEGREES) for name in space.parameterization.names])
        else:
            scale = torch.ones(4)
        self.register_buffer("scale", scale.float(), persistent=False)

    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Mean penalty over the four numbers; ``aspect`` plays no part."""
        predicted, truth = at_least_single(predicted, truth)
        size = ((predicted - truth) * self.scale).abs()
        penalty = size.square()
        if self.penalty == "huber":
            penalty = torch.where(size <= self.delta, penalty, self.delta * (2 * size - self.delta))
        if self.paced is not None:
            penalty = torch.exp(-self.log_variance) * penalty + self.log_variance
        return penalty.mean(-1)

    @property
    def log_variance(self) -> Float[Tensor, "4"]:
        """The logarithms of the learned variances, in widths of the ranges squared; 0 unless they are learned."""
        return torch.zeros_like(self.scale) if self.paced is None else PACE * self.paced
