"""The strongest response of each filter in each image or tile of it, without writing responses to memory."""

from functools import cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int64
from numpy import ndarray
from torch import Tensor

from sextant.layers.cosfire.plan import Plan

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
