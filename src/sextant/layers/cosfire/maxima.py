"""The strongest response of each filter in each image, without writing responses to memory."""

from functools import cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.plan import Plan


def log_maxima(wide: Float[Tensor, "b u H W"], weights: Float[Tensor, "n"], plan: Plan) -> Float[Tensor, "b f"]:
    """max over forms and pixels of Σ w log s, one number for each filter.

    Args:
        wide: logarithms of the maps, wider than responses by ``plan.margin`` on every side.
    """
    places = [np.array(values, dtype=np.int64) for values in (plan.source, plan.dx, plan.dy)]
    part_ends = np.array([0, *(own.stop for own in plan.parts)], dtype=np.int64)
    form_ends = np.array([0, *(own.stop for own in plan.forms)], dtype=np.int64)
    maps = wide.detach().contiguous().numpy()
    found = np.empty((len(maps), len(plan.forms)), dtype=maps.dtype)
    _loop()(maps, plan.margin, *places, weights.detach().numpy().astype(maps.dtype), part_ends, form_ends, found)
    return torch.from_numpy(found)


def _strongest(
    maps: Any, margin: int, source: Any, dx: Any, dy: Any, weights: Any, part_ends: Any, form_ends: Any, found: Any
) -> None:
    height, width = maps.shape[2] - 2 * margin, maps.shape[3] - 2 * margin
    line = np.empty(width, dtype=maps.dtype)
    for image in range(maps.shape[0]):
        for number in range(len(form_ends) - 1):
            best = -np.inf
            for form in range(form_ends[number], form_ends[number + 1]):
                for y in range(height):
                    for x in range(width):
                        line[x] = 0
                    for part in range(part_ends[form], part_ends[form + 1]):
                        row = maps[image, source[part], margin + dy[part] + y]
                        left, weight = margin + dx[part], weights[part]
                        for x in range(width):
                            line[x] += weight * row[left + x]
                    for x in range(width):
                        best = max(best, line[x])
            found[image, number] = best


@cache
def _loop() -> Any:
    from sextant.compiled import compiled  # Numba takes a second to import

    return compiled(_strongest)
