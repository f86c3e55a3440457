"""How the responses of a filter's parts are combined: by a logical *and*, more or less strict."""

from typing import Literal

import torch
from jaxtyping import Float, Int64
from torch import Tensor

#: geometric is the paper's; trimmed leaves out a fifth at either end
Mean = Literal["geometric", "arithmetic", "harmonic", "trimmed", "median"]


def weighted_mean(parts: Float[Tensor, "n *b"], weights: Float[Tensor, "n"], mean: Mean) -> Float[Tensor, "*b"]:
    r"""The mean of n non-negative responses, with weights that sum to one.

    Geometric :math:`\prod s_i^{w_i}`, arithmetic :math:`\sum w_i s_i`, harmonic :math:`(\sum w_i / s_i)^{-1}`;
    trimmed and median ignore the weights. A response of zero makes the geometric and the harmonic mean zero, with
    gradients of zero.

    >>> weighted_mean(torch.tensor([0.25, 1.0]), torch.tensor([0.5, 0.5]), "geometric")
    tensor(0.5000)
    """
    if mean == "arithmetic":
        return torch.einsum("n...,n->...", parts, weights.to(parts))
    if mean in ("geometric", "harmonic"):
        absent = parts <= 0
        present = parts.masked_fill(absent, 1.0)
        total = torch.einsum("n...,n->...", present.log() if mean == "geometric" else 1 / present, weights.to(parts))
        return (total.exp() if mean == "geometric" else 1 / total).masked_fill(absent.any(0), 0.0)
    cut = len(parts) // 5 if mean == "trimmed" else (len(parts) - 1) // 2
    return parts.sort(0).values[cut : len(parts) - cut].mean(0)


def shares(weights: Float[Tensor, "n"], form: Int64[Tensor, "n"], forms: int) -> Float[Tensor, "n"]:
    """Weights scaled to sum to one in each form; those that training made negative count almost nothing."""
    positive = weights.clamp(min=1e-9)
    return positive / positive.new_zeros(forms).index_add(0, form, positive)[form]


def safe_log(x: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Logarithms of non-negative numbers; that of 0 is -inf, with a gradient of 0."""
    if not (torch.is_grad_enabled() and x.requires_grad):
        return x.log()
    absent = x <= 0
    return x.masked_fill(absent, 1.0).log().masked_fill(absent, -torch.inf)
