"""Where houses fit along the lot lines of a block."""

import numpy as np
import shapely
from shapely import Polygon

from sextant.worlds.blocks import Ground, Side


def plots_along(ground: Ground, block: int, density: float, rng: np.random.Generator) -> list[list[float]]:
    """Plots along each side of a block: terraced houses where ``density`` is above one half, detached ones elsewhere.

    Returns:
        x, y, heading, width, depth, density, and 1 or 0 for: terraced, joined on the left, joined on the right.
    """
    lot = ground.lots[block]
    if lot.is_empty:
        return []
    shapely.prepare(lot)
    rows: list[list[float]] = []
    taken: list[Polygon] = []
    for side in ground.sides(block):
        local = float(np.clip(density + 0.12 * rng.normal(), 0.02, 1))
        terrace = local > 0.5
        setback = rng.uniform(0.0, 0.4) if terrace else rng.uniform(2.5, 6.0)
        s, end = (0.3 if terrace else 2.0), -np.inf
        while s < side.length - 5:
            width = rng.uniform(7.5, 15) if terrace else rng.uniform(8, 13)
            if terrace and side.length - s - width < 6:
                width = min(side.length - s - 0.3, 20.0)
            back = setback + (0.0 if terrace else rng.uniform(-0.6, 0.6))
            outline = _fitting(lot, taken, side, s, width, back, (rng.uniform(10, 14), 8.5, 6.5))
            if outline is None:
                s += 2.5
                continue
            depth = outline.area / width
            joined = terrace and s - end < 0.1
            if joined:
                rows[-1][8] = 1.0
            taken.append(shapely.buffer(outline, -0.05 if terrace else 1.2, join_style="mitre"))
            x, y = side.at(s + width / 2, back + depth / 2)
            rows.append([x, y, side.heading, width, depth, local, float(terrace), float(joined), 0.0])
            end = s + width
            s = end + (0.02 if terrace and rng.random() > 0.06 else rng.uniform(2.5, 7.0))
    return rows


def _fitting(
    lot: Polygon, taken: list[Polygon], side: Side, s: float, width: float, back: float, depths: tuple[float, ...]
) -> Polygon | None:
    """The deepest rectangle at ``s`` along ``side`` that lies within the lot and clear of occupied ground."""
    for depth in depths:
        corners = ((s, back), (s + width, back), (s + width, back + depth), (s, back + depth))
        outline = Polygon([side.at(*corner) for corner in corners])
        if lot.contains(outline) and not any(outline.intersects(other) for other in taken):
            return outline
    return None
