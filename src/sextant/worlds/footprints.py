"""Buildings that stand where a map says: footprints fitted between the streets, and houses designed on them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.spatial import cKDTree
from shapely import Polygon, affinity

from sextant.worlds.blocks import KERB_M, Ground
from sextant.worlds.building_design import FLAT, Buildings, design

#: of a storey, where only their number is known; the lowest walls under a roof, metres
STOREY_M, LOWEST_M = 3.0, 2.2
#: a footprint is left out where less than this is left of it: square metres, and a share of its area
LEAST_M2, LEAST_SHARE = 12.0, 0.5
#: a footprint that fills this share of the smallest rectangle around it is one; a pitched roof spans at most so much
RECTANGULAR, WIDEST_ROOF_M = 0.93, 18.0
#: a wall so near to a footprint adjoins it
ADJOINS_M = 0.4


@dataclass(frozen=True)
class Footprint:
    """The ground that a building stands on.

    Attributes:
        outline: metres; holes are courtyards.
        height_m: of the building with its roof; None for any.
        storeys: their number; None for any.
    """

    outline: Polygon
    height_m: float | None = None
    storeys: int | None = None


def fit_footprints(footprints: Sequence[Footprint], ground: Ground) -> list[Footprint | None]:
    """Each footprint cut back to the edge of the pavements and to larger ones that it overlaps and that stand.

    Returns:
        None for those of which less than half, or less than 12 m², is left.
    """
    free = shapely.union_all(ground.lots)
    shapely.prepare(free)
    outlines = np.array([shapely.make_valid(each.outline) for each in footprints], object)
    areas = shapely.area(outlines)
    near, stand = shapely.STRtree(outlines), np.zeros(len(outlines), bool)
    found: list[Footprint | None] = [None] * len(outlines)
    for i in np.argsort(-areas, kind="stable").tolist():
        shape = outlines[i] if free.contains(outlines[i]) else shapely.intersection(outlines[i], free)
        others = near.query(outlines[i], predicate="intersects")
        if stand[others].any():
            shape = shapely.difference(shape, shapely.union_all(outlines[others[stand[others]]]))
        pieces = [piece for piece in shapely.get_parts(shape).tolist() if isinstance(piece, Polygon)]
        outlines[i] = shapely.simplify(max(pieces, key=lambda piece: piece.area, default=Polygon()), 0.1)
        if outlines[i].area >= max(LEAST_M2, LEAST_SHARE * areas[i]):
            stand[i], found[i] = True, replace(footprints[i], outline=outlines[i])
    return found


def houses_on(
    footprints: Sequence[Footprint], ground: Ground, density: float, rng: np.random.Generator
) -> tuple[Buildings, dict[int, Polygon]]:
    """Buildings on footprints that :func:`fit_footprints` returned, and the outlines of those that are no rectangles.

    A rectangle becomes a house that faces the street nearest to it; other outlines get walls along each side and a flat
    roof. A building without a height is as tall as the nearest that has one; without any, as ``density`` makes it.
    """
    outlines = np.array([each.outline for each in footprints], object)
    boxes = [_box(outline) for outline in outlines]
    free = shapely.union_all(ground.lots).buffer(0.02)
    shapely.prepare(free)
    rectangular = np.array([
        outline.area > RECTANGULAR * shapely.oriented_envelope(outline).area
        and free.contains(box)
        for outline, box in zip(outlines, boxes, strict=True)
    ], bool)  # fmt: skip
    placed = np.array([_facing(box, ground.roads) for box in boxes]).reshape(-1, 5)
    heading, size = placed[:, 2], placed[:, 3:]
    attached = _attached(placed, outlines)
    storeys = _storeys(footprints, placed[:, :2])
    built_up = np.where(np.isnan(storeys), density + 0.2 * rng.normal(size=len(outlines)), 0.1 + 0.17 * storeys)
    position = np.column_stack([placed[:, :2], np.full(len(placed), KERB_M)])
    b = design(position, heading, size, np.clip(built_up, 0.02, 1), attached, attached[:, 0] | attached[:, 1], rng)
    return _as_tall(b, footprints, storeys, rectangular), {
        int(i): shapely.geometry.polygon.orient(outlines[i]) for i in np.flatnonzero(~rectangular)
    }


def _storeys(footprints: Sequence[Footprint], middles: Float64[ndarray, "n 2"]) -> Float64[ndarray, "n"]:
    """As given or as the height says, otherwise those of the nearest building where they are; nan if none says."""
    height = np.array([np.nan if each.height_m is None else each.height_m for each in footprints])
    given = np.array([np.nan if each.storeys is None else each.storeys for each in footprints])
    found = np.maximum(1, np.round(np.where(np.isnan(given), height / STOREY_M, given)))
    known = np.flatnonzero(~np.isnan(found))
    return found[known[cKDTree(middles[known]).query(middles)[1]]] if len(known) else found


def _box(outline: Polygon) -> Polygon:
    """The rectangle of an outline's area around it, with the proportions of the smallest that holds it."""
    around = shapely.oriented_envelope(outline)
    share = np.sqrt(shapely.Polygon(outline.exterior).area / around.area)
    return affinity.scale(around, share, share)


def _facing(box: Polygon, roads: shapely.Geometry) -> tuple[float, float, float, float, float]:
    """Middle, heading, width and depth of a rectangle, seen from the side that is nearest to a carriageway."""
    corners = np.asarray(shapely.geometry.polygon.orient(box).exterior.coords)
    sides = np.diff(corners, axis=0)  # counter-clockwise: the building lies to the left
    front = int(np.argmin(shapely.distance(shapely.points(corners[:-1] + sides / 2), roads)))
    width, depth = (float(np.hypot(*sides[(front + k) % 4])) for k in (0, 1))
    return box.centroid.x, box.centroid.y, float(np.arctan2(*sides[front][::-1])), width, depth


def _attached(placed: Float64[ndarray, "n 5"], outlines: ndarray) -> Bool[ndarray, "n 2"]:
    """Whether another footprint adjoins the left and the right side of each rectangle."""
    x, y, heading, width, _ = placed.T
    reach = width / 2 + ADJOINS_M
    found = np.zeros((len(placed), 2), bool)
    for side, way in enumerate((-1, 1)):
        beside = shapely.points(x + way * reach * np.cos(heading), y + way * reach * np.sin(heading))
        found[shapely.STRtree(outlines).query(beside, predicate="within")[0], side] = True
    return found


def _as_tall(
    b: Buildings, footprints: Sequence[Footprint], storeys: Float64[ndarray, "n"], rectangular: Bool[ndarray, "n"]
) -> Buildings:
    """The buildings with the storeys and heights that are known, and flat roofs where no other would do."""
    storeys = np.where(np.isnan(storeys), b.storeys, storeys)
    pitched = rectangular & (b.size[:, :2].min(axis=1) <= WIDEST_ROOF_M) & (storeys <= 5)
    roof = np.where(pitched, b.roof, FLAT)
    rise = np.where(roof == FLAT, 0.0, b.rise)
    told = np.array([np.nan if each.height_m is None else each.height_m for each in footprints])
    walls = np.where(np.isnan(told), storeys * STOREY_M, np.maximum(told - rise, LOWEST_M))
    return replace(
        b,
        size=np.column_stack([b.size[:, :2], walls]),
        roof=roof,
        rise=np.where(np.isnan(told), rise, np.clip(told - walls, 0.0, rise)),
        storeys=storeys.astype(np.int64),
        ground=np.minimum(b.ground, np.where(storeys > 1, 1.3 * walls / storeys, walls - 0.2)),
    )
