"""The parts of a filter: channels with their distance and direction from the centre."""

from dataclasses import dataclass
from typing import Literal, get_args

import torch
from jaxtyping import Float, Int64, Shaped
from torch import Tensor

from sextant.layers.floating import require_floating

#: geometric is the paper's; trimmed leaves out a fifth at either end
Mean = Literal["geometric", "arithmetic", "harmonic", "trimmed", "median"]


def weighted_mean(parts: Float[Tensor, "n *b"], weights: Float[Tensor, "n"], mean: Mean) -> Float[Tensor, "*b"]:
    r"""The mean of n non-negative responses, with weights that sum to one.

    Geometric :math:`\prod s_i^{w_i}`, arithmetic :math:`\sum w_i s_i`, harmonic :math:`(\sum w_i / s_i)^{-1}`;
    trimmed and median ignore the weights. A response of zero makes the geometric and the harmonic mean zero, with
    gradients of zero.

    Raises:
        UserError: the responses are not floating-point.
        ValueError: there is no such mean.

    >>> weighted_mean(torch.tensor([0.25, 1.0]), torch.tensor([0.5, 0.5]), "geometric")
    tensor(0.5000)
    """
    if mean not in get_args(Mean):
        raise ValueError(f"mean must be one of {', '.join(get_args(Mean))}; got {mean!r}")
    require_floating(parts, "parts")
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
    """Weights scaled to sum to one in each form; those that training made negative become almost 0."""
    positive = weights.clamp(min=1e-9)
    return positive / positive.new_zeros(forms).index_add(0, form, positive)[form]


def safe_log(x: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Logarithms of non-negative numbers; that of 0 is -inf, with a gradient of 0."""
    if not (torch.is_grad_enabled() and x.requires_grad):
        return x.log()
    absent = x <= 0
    return x.masked_fill(absent, 1.0).log().masked_fill(absent, -torch.inf)


@dataclass(frozen=True)
class Tuples:
    """n parts, all arrays in float64.

    Args:
        channels: rows that name channels of a bank.
        rho: distances from the filter's centre, in pixels of the maps.
        phi: directions, in rad, counter-clockwise from the x axis.
    """

    channels: Float[Tensor, "n p"]
    rho: Float[Tensor, "n"]
    phi: Float[Tensor, "n"]

    def __len__(self) -> int:
        return len(self.rho)

    @classmethod
    def at(cls, channels: Float[Tensor, "n p"], dx: Shaped[Tensor, "n"], dy: Shaped[Tensor, "n"]) -> "Tuples":
        """Parts at ``dx`` pixels to the right and ``dy`` downwards."""
        return cls(channels.double(), torch.hypot(dx.double(), dy.double()), torch.atan2(-dy.double(), dx.double()))


def offsets(rho: Float[Tensor, "n"], phi: Float[Tensor, "n"]) -> tuple[Float[Tensor, "n"], Float[Tensor, "n"]]:
    """(dx, dy) in pixels, y downwards: ρ cos φ and -ρ sin φ."""
    return rho * torch.cos(phi), -rho * torch.sin(phi)


def whole_offsets(rho: Float[Tensor, "n"], phi: Float[Tensor, "n"]) -> tuple[list[int], list[int]]:
    """(dx, dy) in whole pixels; halves, also those that rounding errors have shifted, go away from zero."""
    dx, dy = (_rounded(offset.detach()) for offset in offsets(rho, phi))
    return dx, dy


def _rounded(offset: Tensor) -> list[int]:
    near = torch.round(offset.double(), decimals=4)
    return (near.sign() * (near.abs() + 0.5).floor()).long().tolist()


def part_weights(rho: Float[Tensor, "n"], least: float) -> Float[Tensor, "n"]:
    r"""Weights of the parts, summing to one: :math:`w_i \propto e^{-\rho_i^2 / 2\sigma_w^2}`.

    σ_w is such that the outermost part has ``least`` times the weight of the centre; with 1 all have the same weight.
    """
    farthest = rho.max()
    if least == 1 or farthest == 0:
        return torch.full_like(rho, 1 / len(rho))
    weights = torch.exp(torch.log(torch.tensor(least, dtype=rho.dtype)) * (rho / farthest) ** 2)
    return weights / weights.sum()
