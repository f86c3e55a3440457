r"""Generalised mean pooling: per channel :math:`\big(\frac1{hw} \sum_i \max(x_i, \epsilon)^p\big)^{1/p}`, p learnt.

p = 1 is the mean, and p to infinity the maximum.

Source: F. Radenovic et al., "Fine-tuning CNN image retrieval with no human annotation", TPAMI 2019, which starts at
p = 3.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.models.pooling.pooling import Pooling

SMALLEST_FEATURE = 1e-6
#: p is clamped to this range: beyond it, powers would overflow in float32, or the mean would lose its meaning
P_RANGE = (1.0, 12.0)


def generalised_mean(x: Float[Tensor, "b c h w"], p: Float[Tensor, ""] | float) -> Float[Tensor, "b c"]:
    """``(mean max(x, eps)^p)^(1/p)`` over the map, computed relative to the largest feature of each channel."""
    x = x.clamp(min=SMALLEST_FEATURE)
    largest = x.detach().amax((2, 3), keepdim=True)
    return (x / largest).pow(p).mean((2, 3)).pow(1 / p) * largest[:, :, 0, 0]


class GeM(Pooling):
    """Generalised mean; see the module. It is computed in float32 or wider.

    Args:
        channels, size: those of the map; any size is accepted.
        p: initial value of the exponent, within :data:`P_RANGE`.
        train_p: learn the exponent.

    Raises:
        UserError: p is out of its range.

    Example:
        >>> GeM(channels=1, size=(1, 2), p=2.0)(torch.tensor([[[[1.0, 7.0]]]])).item()  # sqrt((1 + 49) / 2)
        5.0
    """

    p: Tensor

    def __init__(self, channels: int, size: tuple[int, int], *, p: float = 3.0, train_p: bool = True):
        super().__init__(channels, size, channels)
        if not P_RANGE[0] <= p <= P_RANGE[1]:
            raise ArgumentError(f"p={p} must be in [{P_RANGE[0]:g}, {P_RANGE[1]:g}]", "p=3")
        self.p = nn.Parameter(torch.tensor(float(p)), requires_grad=train_p)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c"]:
        """Generalised mean of each channel; p is clamped to its range but keeps its gradient beyond."""
        p = self.p + (self.p.clamp(*P_RANGE) - self.p).detach()
        return generalised_mean(x.to(torch.promote_types(x.dtype, torch.float32)), p)
