"""Responses of filters from the blurred maps of a bank: shift, weigh, put together."""

from collections.abc import Iterator

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

    Args:
        wide: logarithms of the maps, wider than responses by ``plan.margin`` on every side.
    """
    height, width = (size - 2 * plan.margin for size in wide.shape[-2:])
    numbers = None if weights.requires_grad else weights.tolist()
    for own in plan.parts:
        total: Tensor | None = None
        for part in own:
            top, left = plan.margin + plan.dy[part], plan.margin + plan.dx[part]
            view = wide[:, plan.source[part], top : top + height, left : left + width]
            if numbers is None:
                total = view * weights[part] if total is None else total + view * weights[part]
            else:
                total = view * numbers[part] if total is None else torch.add(total, view, alpha=numbers[part])
        assert total is not None
        yield total


def whole_responses(
    wide: Float[Tensor, "b u H W"], weights: Float[Tensor, "n"], plan: Plan, mean: Mean
) -> Iterator[Float[Tensor, "b h w"]]:
    """Any mean of maps shifted by whole pixels; ``wide`` as in :func:`log_responses`, but the maps themselves."""
    height, width = (size - 2 * plan.margin for size in wide.shape[-2:])
    for own in plan.parts:
        parts = []
        for part in own:
            top, left = plan.margin + plan.dy[part], plan.margin + plan.dx[part]
            parts.append(wide[:, plan.source[part], top : top + height, left : left + width])
        yield weighted_mean(torch.stack(parts), weights[own.start : own.stop], mean)


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
    """Any mean of maps shifted by ρ and φ, between pixels bilinearly, and so differentiable in both.

    Args:
        fill: beyond a border of ``zeros``.
    """
    height, width = maps.shape[-2:]
    across, down = offsets(rho, phi)
    margin = int(torch.cat([across, down]).detach().abs().max()) + 2
    wide = padded(maps, (margin,) * 4, border, fill)
    for own in plan.parts:
        parts = []
        for part in own:
            left, top = torch.floor(across[part].detach()), torch.floor(down[part].detach())
            x_share, y_share = (across[part] - left).to(maps), (down[part] - top).to(maps)
            x, y = margin + int(left), margin + int(top)
            source = wide[:, plan.source[part], y : y + height + 1, x : x + width + 1]
            rows = source[..., :-1] * (1 - x_share) + source[..., 1:] * x_share
            parts.append(rows[:, :-1] * (1 - y_share) + rows[:, 1:] * y_share)
        yield weighted_mean(torch.stack(parts), weights[own.start : own.stop], mean)
