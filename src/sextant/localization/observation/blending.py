r"""Weights of the m nearest of many places that change continuously as one moves.

.. math:: w_i \propto e^{-d_i^2} - e^{-d_{m+1}^2}, \qquad i = 1, \dots, m

with the distances :math:`d_1 \le \dots \le d_{m+1}`. The place that leaves the m nearest has weight 0 as it leaves, as
has the one that comes. Only where all m + 1 are equally far are the weights not continuous; there they are equal.
"""

import torch
from jaxtyping import Float64
from torch import Tensor


def blending_weights(squared: Float64[Tensor, "n k"], m: int) -> Float64[Tensor, "n m"]:
    """The weights of the m nearest; each row sums to one.

    Args:
        squared: distances of the nearest, ascending: m + 1 of them, or m if there are no more.
        m: how many have a weight.
    """
    falling = torch.exp(squared[:, :1] - squared)  # to the nearest one's: far from everything all else is 0
    weights = falling[:, :m] - falling[:, m:] if squared.shape[1] > m else falling
    total = weights.sum(dim=1, keepdim=True)
    return torch.where(total > 0, weights / total, torch.full_like(weights, 1 / m))
