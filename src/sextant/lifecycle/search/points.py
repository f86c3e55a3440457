"""Points of a space by number: of a grid, and of a replayed evolution."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from cmaes import CMA

from sextant.config.schema.space import Dimension

Space = Mapping[str, Dimension]


def grid_point(space: Space, number: int) -> dict[str, Any]:
    """Point ``number`` of the grid of all combinations; the last key changes fastest."""
    point: dict[str, Any] = {}
    for key, found in reversed(list(space.items())):
        values = found.options or range(int(found.low), int(found.high) + 1)
        number, place = divmod(number, len(values))
        point[key] = values[place]
    return dict(reversed(point.items()))


def cma_point(space: Space, told: Sequence[tuple[Mapping[str, Any], float]], number: int, seed: int) -> dict[str, Any]:
    """The next point of CMA-ES after replaying all complete generations of ``told`` in order.

    Args:
        space: search space of two or more numbers, without choices.
        told: points with their values; higher is better, minus infinity is worst.
        number: number of the requested trial; its random numbers depend only on this and the seed.
        seed: seed of the search.

    References:
        Hansen, The CMA Evolution Strategy: A Tutorial, 2016.
    """
    count = len(space)
    evolution = CMA(mean=np.full(count, 0.5), sigma=1 / 6, bounds=np.tile([0.0, 1.0], (count, 1)), seed=seed)
    size = evolution.population_size
    for start in range(0, len(told) - size + 1, size):
        generation = told[start : start + size]
        worst = min((value for _, value in generation if math.isfinite(value)), default=0.0)
        evolution.tell([(_unit(space, params), -max(value, worst)) for params, value in generation])
    evolution.reseed_rng(int(np.random.SeedSequence([seed, number]).generate_state(1)[0]))
    return {key: _from_unit(found, share) for (key, found), share in zip(space.items(), evolution.ask(), strict=True)}


def _unit(space: Space, params: Mapping[str, Any]) -> np.ndarray:
    return np.array([_share(found, float(params[key])) for key, found in space.items()])


def _share(found: Dimension, value: float) -> float:
    """The position of a value within its bounds, from 0 to 1."""
    low, high, value = map(math.log if found.kind == "log_uniform" else float, (found.low, found.high, value))
    return (value - low) / (high - low)


def _from_unit(found: Dimension, share: float) -> float:
    """The value at a position within the bounds, rounded for whole numbers."""
    if found.kind == "log_uniform":
        low, high = math.log(found.low), math.log(found.high)
        return min(max(math.exp(low + share * (high - low)), found.low), found.high)
    value = min(max(found.low + share * (found.high - found.low), found.low), found.high)
    return round(value) if found.kind == "int" else value
