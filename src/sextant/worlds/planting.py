"""Where trees stand: along pavements, in gardens and parks, and in the countryside around a town."""

import numpy as np
import shapely
from shapely import Polygon

from sextant.worlds.blocks import PAVEMENT_M, Ground
from sextant.worlds.shading.noise import value_noise

#: x, y, size, and 1 for a conifer
Planted = tuple[float, float, float, float]


def street_trees(ground: Ground, block: int, rng: np.random.Generator) -> list[Planted]:
    """Rows of trees along the kerb of a block."""
    rows: list[Planted] = []
    for side in ground.sides(block, inset=-PAVEMENT_M + 1.25, shortest_m=16):
        if rng.random() < 0.72:
            gap = rng.uniform(9, 15)
            for s in np.arange(6 + rng.uniform(0, 4), side.length - 6, gap):
                if rng.random() < 0.85:
                    x, y = side.at(s, rng.uniform(-0.1, 0.15))
                    rows.append((x, y, rng.uniform(0.5, 0.8), 0.0))
    return rows


def garden_trees(lot: Polygon, density: float, rng: np.random.Generator) -> list[Planted]:
    """Trees in the gardens of a lot: fewer where it is more built-up, more in a park (``density`` below 0)."""
    if lot.is_empty:
        return []
    every = 110.0 if density < 0 else 130.0 + 420.0 * density  # square metres per tree
    left, bottom, right, top = lot.bounds
    n = int((right - left) * (top - bottom) / every)
    points = rng.uniform((left, bottom), (right, top), (n, 2))
    within = shapely.contains_xy(lot.buffer(-1.5), points[:, 0], points[:, 1])
    size = rng.uniform(0.55, 1.25, n)
    conifer = rng.random(n) < 0.16
    return [(*points[i], size[i], float(conifer[i])) for i in np.flatnonzero(within)]


def country_trees(ground: Ground, seed: int, most: int, rng: np.random.Generator) -> list[Planted]:
    """Woods and solitary trees up to 400 m around the town."""
    left, bottom, right, top = ground.graph.bounds
    area = (right - left + 800) * (top - bottom + 800) - (right - left) * (top - bottom)
    n = int(min(area / 420, most))
    points = rng.uniform((left - 400, bottom - 400), (right + 400, top + 400), (n, 2))
    outer = ground.lots[-1]
    shapely.prepare(outer)
    within = shapely.contains_xy(outer, points[:, 0], points[:, 1])
    rows: list[Planted] = []
    for i in np.flatnonzero(within):
        wood = value_noise(points[i, 0] / 70.0, points[i, 1] / 70.0, 2000 + seed)
        if rng.random() < (0.9 if wood > 0.62 else 0.12):
            rows.append((*points[i], rng.uniform(0.8, 1.5), float(rng.random() < 0.15 + 0.9 * (wood > 0.75))))
    return rows
