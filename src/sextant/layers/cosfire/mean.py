"""How the responses of a filter's parts become one: a logical *and*, more or less strict."""

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

#: geometric is the paper's; trimmed leaves out a fifth at either end
Mean = Literal["geometric", "arithmetic", "harmonic", "trimmed", "median"]


def weighted_mean(parts: Float[Tensor, "n *b"], weights: Float[Tensor, "n"], mean: Mean) -> Float[Tensor, "*b"]:
    r"""The mean of n non-negative responses, with weights that sum to one.

    Geometric :math:`\prod s_i^{w_i}`, arithmetic :math:`\sum w_i s_i`, harmonic :math:`(\sum w_i / s_i)^{-1}`;
    trimmed and median ignore the weights. A response of zero makes the geometric and the harmonic mean zero.
    """
    if mean == "geometric":
        return torch.exp(torch.einsum("n...,n->...", safe_log(parts), weights.to(parts)))
    if mean == "arithmetic":
        return torch.einsum("n...,n->...", parts, weights.to(parts))
    if mean == "harmonic":
        present = parts > 0
        shares = torch.einsum("n...,n->...", 1 / torch.where(present, parts, 1.0), weights.to(parts))
        return torch.where(present.all(0), 1 / shares, 0.0)
    if mean == "trimmed":
        ordered = parts.sort(0).values
        cut = len(parts) // 5
        return ordered[cut : len(parts) - cut].mean(0)
    return torch.quantile(parts, 0.5, dim=0)


def safe_log(x: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Logarithms of non-negative numbers; that of 0 is -inf, with a gradient of 0."""
    if not (torch.is_grad_enabled() and x.requires_grad):
        return x.log()
    present = x > 0
    return torch.where(present, x, 1.0).log().masked_fill(~present, -torch.inf)
