"""Responses of filters from the blurred maps of a bank: shift, weight and combine."""

from collections.abc import Iterator, Sequence
from functools import reduce

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.border import Border, padded
from sextant.layers.cosfire.mean import Mean, weighted_mean
from sextant.layers.cosfire.plan import Plan
from sextant.layers.cosfire.tuples import offsets


def log_responses(
    wide: Float[Tensor, "b u H W"], weights: Float[Tensor, "n"], plan: Plan
) -> Iterator[Float[Tensor, "b h w"]]:
    """Logarithms of the weighted geometric means, one form after the other.

    Without gradients, all forms are written to the same memory: each is valid until the next is requested.

    Args:
        wide: logarithms of the maps, wider than responses by ``plan.margin`` on every side.
    """
    if torch.is_grad_enabled() and (wide.requires_grad or weights.requires_grad):
        yield from _differentiable_log_responses(wide, weights, plan)
        return
    maps, numbers = wide.unbind(1), weights.tolist()
    total = torch.empty_like(_seen_by(0, maps, plan), memory_format=torch.contiguous_format)
    for own in plan.parts:
        torch.mul(_seen_by(own[0], maps, plan), numbers[own[0]], out=total)
        for part in own[1:]:
            total.add_(_seen_by(part, maps, plan), alpha=numbers[part])
        yield total


def whole_responses(
    wide: Float[Tensor, "b u H W"], weights: Float[Tensor, "n"], plan: Plan, mean: Mean
) -> Iterator[Float[Tensor, "b h w"]]:
    """Any mean of maps shifted by whole pixels; ``wide`` as in :func:`log_responses`, but the maps themselves."""
    maps = wide.unbind(1)
    for own in plan.parts:
        parts = torch.stack([_seen_by(part, maps, plan) for part in own])
        yield weighted_mean(parts, weights[own.start : own.stop], mean)


def bilinear_responses(
    maps: Float[Tensor, "b u h w"],
    weights: Float[Tensor, "n"],
    rho: Float[Tensor, "n"],
    phi: Float[Tensor, "n"],
    plan: Plan,
    mean: Mean,
    border: Border,
    fill: float,
) -> Iterator[Float[Tensor, "b h w"]]:
    """Any mean of maps shifted by ρ and φ, bilinearly between pixels and so differentiable in both.

    Args:
        fill: value beyond a border of ``zeros``.
    """
    height, width = maps.shape[-2:]
    across, down = offsets(rho, phi)
    margin = int(torch.cat([across, down]).detach().abs().max()) + 2
    wide = padded(maps, margin, border, fill).unbind(1)
    for own in plan.parts:
        parts = []
        for part in own:
            left, top = torch.floor(across[part].detach()), torch.floor(down[part].detach())
            x_share, y_share = (across[part] - left).to(maps), (down[part] - top).to(maps)
            x, y = margin + int(left), margin + int(top)
            source = wide[plan.source[part]][:, y : y + height + 1, x : x + width + 1]
            rows = source[..., :-1] * (1 - x_share) + source[..., 1:] * x_share
            parts.append(rows[:, :-1] * (1 - y_share) + rows[:, 1:] * y_share)
        yield weighted_mean(torch.stack(parts), weights[own.start : own.stop], mean)


def _differentiable_log_responses(wide: Tensor, weights: Tensor, plan: Plan) -> Iterator[Tensor]:
    """As :func:`log_responses`; where a part is absent all gradients are 0, not 0 times infinity."""
    absent = torch.isneginf(wide)
    finite, missing, numbers = wide.masked_fill(absent, 0.0).unbind(1), absent.unbind(1), weights.unbind(0)
    for own in plan.parts:
        total = reduce(torch.add, [_seen_by(part, finite, plan) * numbers[part] for part in own])
        nothing = reduce(torch.logical_or, [_seen_by(part, missing, plan) for part in own])
        yield total.masked_fill(nothing, -torch.inf)


def _seen_by(part: int, maps: Sequence[Tensor], plan: Plan) -> Tensor:
    """What a part sees from each pixel (b, h, w): its map, shifted.

    Maps are passed apart, by ``unbind``: the gradient of a slice of their stack would be as large as the whole stack.
    """
    seen = maps[plan.source[part]]
    height, width = (size - 2 * plan.margin for size in seen.shape[-2:])
    top, left = plan.margin + plan.dy[part], plan.margin + plan.dx[part]
    return seen[:, top : top + height, left : left + width]
