"""The strongest response of each filter in each image, without writing responses to memory."""

from functools import cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.plan import Plan

#: images side by side, so that a pass along a row is long
TOGETHER = 8


def log_maxima(wide: Float[Tensor, "b u H W"], weights: Float[Tensor, "n"], plan: Plan) -> Float[Tensor, "b f"]:
    """max over forms and pixels of Σ w log s, one number for each filter.

    Args:
        wide: logarithms of the maps, wider than responses by ``plan.margin`` on every side.
    """
    places = [np.array(values, dtype=np.int64) for values in (plan.source, plan.dx, plan.dy)]
    part_ends = np.array([0, *(own.stop for own in plan.parts)], dtype=np.int64)
    form_ends = np.array([0, *(own.stop for own in plan.forms)], dtype=np.int64)
    found = np.empty((len(wide), len(plan.forms)), dtype=wide.detach().numpy().dtype)
    numbers = weights.detach().numpy().astype(found.dtype)
    for start in range(0, len(wide), TOGETHER):
        images = slice(start, start + TOGETHER)
        maps = wide[images].detach().permute(1, 2, 3, 0).contiguous().numpy()
        _loop()(maps, plan.margin, *places, numbers, part_ends, form_ends, found[images])
        found[images][np.isnan(maps).any((0, 1, 2))] = np.nan  # comparisons pass over it
    return torch.from_numpy(found)


def _strongest(
    maps: Any, margin: int, source: Any, dx: Any, dy: Any, weights: Any, part_ends: Any, form_ends: Any, found: Any
) -> None:
    count = maps.shape[3]
    height, width = maps.shape[1] - 2 * margin, maps.shape[2] - 2 * margin
    rows = maps.reshape(maps.shape[0], maps.shape[1], -1)
    line, best = np.empty(width * count, dtype=maps.dtype), np.empty(width * count, dtype=maps.dtype)
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
                for x in range(width * count):
                    best[x] = max(best[x], line[x])
        found[:, number] = -np.inf
        for x in range(width * count):
            found[x % count, number] = max(found[x % count, number], best[x])


@cache
def _loop() -> Any:
    from sextant.compiled import compiled  # Numba takes a second to import

    return compiled(_strongest)
