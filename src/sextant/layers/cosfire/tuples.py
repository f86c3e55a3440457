"""The parts of a filter: which channel is expected at which distance and direction from the centre."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Shaped
from torch import Tensor


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
