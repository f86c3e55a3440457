"""Responses of filters: shifted and blurred maps, weighted and combined, in full or as their maxima."""

from collections.abc import Iterator, Sequence
from functools import cache, reduce
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int64
from numpy import ndarray
from torch import Tensor

from sextant.layers.cosfire.blur import Border, padded
from sextant.layers.cosfire.plan import Plan
from sextant.layers.cosfire.tuples import Mean, offsets, weighted_mean


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
    """The response of a part at each pixel (b, h, w): its map, shifted.

    Maps are passed separately, by ``unbind``: the gradient of a slice of a stack would be as large as the stack.
    """
    seen = maps[plan.source[part]]
    height, width = (size - 2 * plan.margin for size in seen.shape[-2:])
    top, left = plan.margin + plan.dy[part], plan.margin + plan.dx[part]
    return seen[:, top : top + height, left : left + width]


#: images that are processed side by side, so that a pass along a row is long
TOGETHER = 8


def log_maxima(
    wide: Float[Tensor, "b u H W"], weights: Float[Tensor, "n"], plan: Plan, tiles: int = 1
) -> Float[Tensor, "b m"]:
    """max over forms and pixels of Σ w log s: tiles² numbers for each filter, row by row.

    Args:
        wide: logarithms of the maps, wider than responses by ``plan.margin`` on every side.
        tiles: tiles per side.
    """
    places = [np.array(values, dtype=np.int64) for values in (plan.source, plan.dx, plan.dy)]
    part_ends = np.array([0, *(own.stop for own in plan.parts)], dtype=np.int64)
    form_ends = np.array([0, *(own.stop for own in plan.forms)], dtype=np.int64)
    found = np.empty((len(wide), len(plan.forms), tiles, tiles), dtype=wide.detach().numpy().dtype)
    rows, columns = (_tile_ends(size - 2 * plan.margin, tiles) for size in wide.shape[2:])
    numbers = weights.detach().numpy().astype(found.dtype)
    for start in range(0, len(wide), TOGETHER):
        images = slice(start, start + TOGETHER)
        maps = wide[images].detach().permute(1, 2, 3, 0).contiguous().numpy()
        _loop()(maps, plan.margin, *places, numbers, part_ends, form_ends, rows, columns, found[images])
        found[images][np.isnan(maps).any((0, 1, 2))] = np.nan  # comparisons ignore nan
    return torch.from_numpy(found.reshape(len(wide), -1))


def tile_maxima(response: Float[Tensor, "b f y x"], tiles: int) -> Float[Tensor, "b m"]:
    """The largest response in each tile, row by row, filter after filter."""
    rows, columns = (_tile_ends(size, tiles).tolist() for size in response.shape[2:])
    found = [response[:, :, top:bottom, left:right].amax((2, 3)) for top, bottom in rows for left, right in columns]
    return torch.stack(found, 2).flatten(1)


def _tile_ends(size: int, tiles: int) -> Int64[ndarray, "tiles 2"]:
    """First pixel of each tile and the one after its last; tiles share pixels where they do not fit, as in pooling."""
    first = np.arange(tiles) * size // tiles
    last = -(-np.arange(1, tiles + 1) * size // tiles)
    return np.stack([first, last], 1)


def _strongest(
    maps: Any,
    margin: int,
    source: Any,
    dx: Any,
    dy: Any,
    weights: Any,
    part_ends: Any,
    form_ends: Any,
    tile_rows: Any,
    tile_columns: Any,
    found: Any,
) -> None:
    count = maps.shape[3]
    height, width = maps.shape[1] - 2 * margin, maps.shape[2] - 2 * margin
    rows = maps.reshape(maps.shape[0], maps.shape[1], -1)
    tiles = len(tile_rows)
    line, best = np.empty(width * count, dtype=maps.dtype), np.empty((tiles, width * count), dtype=maps.dtype)
    for number in range(len(form_ends) - 1):
        best[:] = -np.inf
        for form in range(form_ends[number], form_ends[number + 1]):
            for y in range(height):
                line[:] = 0
                for part in range(part_ends[form], part_ends[form + 1]):
                    left, weight = (margin + dx[part]) * count, weights[part]
                    row = rows[source[part], margin + dy[part] + y, left : left + width * count]
                    for x in range(width * count):
                        line[x] += weight * row[x]
                for i in range(tiles):
                    if tile_rows[i, 0] <= y < tile_rows[i, 1]:
                        for x in range(width * count):
                            best[i, x] = max(best[i, x], line[x])
        found[:, number] = -np.inf
        for i in range(tiles):
            for j in range(tiles):
                for x in range(tile_columns[j, 0] * count, tile_columns[j, 1] * count):
                    found[x % count, number, i, j] = max(found[x % count, number, i, j], best[i, x])


@cache
def _loop() -> Any:
    from sextant.compiled import compiled  # Numba takes a second to import

    return compiled(_strongest)
