r"""Weights of the m nearest of many places that change continuously with the position.

.. math:: w_i \propto e^{-d_i^2} - e^{-d_{m+1}^2}, \qquad i = 1, \dots, m

with the distances :math:`d_1 \le \dots \le d_{m+1}`. A place that leaves the m nearest has weight 0 as it leaves, and
so has the one that joins them. The weights are discontinuous only where all m + 1 are equally far; there they are all
equal.
"""

import torch
from jaxtyping import Float64
from torch import Tensor


def blending_weights(squared: Float64[Tensor, "n k"], m: int) -> Float64[Tensor, "n m"]:
    """The weights of the m nearest; each row sums to one.

    Args:
        squared: squared distances of the nearest places, ascending: m + 1 of them, or m if there are no more.
        m: number of places with a weight.
    """
    falling = torch.exp(squared[:, :1] - squared)  # relative to the nearest, as far from everything all would vanish
    weights = falling[:, :m] - falling[:, m:] if squared.shape[1] > m else falling
    total = weights.sum(dim=1, keepdim=True)
    return torch.where(total > 0, weights / total, torch.full_like(weights, 1 / m))
