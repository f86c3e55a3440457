"""Walls of buildings: the facade of each, and all of a building whose footprint is no rectangle."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray
from shapely import Polygon

from sextant.worlds.blocks import flat
from sextant.worlds.building_design import Buildings
from sextant.worlds.mesh import Mesh, instances, quads
from sextant.worlds.roofs import GRAVEL
from sextant.worlds.shading.facade import CURTAIN, HOME, OFFICE, RIBBON
from sextant.worlds.surfaces import Kind, surface_rows

#: of each building: colour of its walls, and of their doors and shutters; how ornate their surrounds are, 0 to 1
Paint = tuple[Float64[ndarray, "n 3"], Float64[ndarray, "n 3"], Float64[ndarray, "n"]]
#: a wall narrower than this has no windows, metres
BLANK_M = 2.2
#: a side of an outline is a front if it is turned by less than this from the building's heading
FRONT_RAD = np.deg2rad(30.0)


def wall_rows(
    b: Buildings,
    width: Float64[ndarray, "n"],
    origin: Float64[ndarray, "n 3"],
    heading: Float64[ndarray, "n"],
    paint: Paint,
    seed: Float64[ndarray, "n"],
    *,
    side: int | Float64[ndarray, "n"],
    front: Bool[ndarray, "n"],
    blank: Bool[ndarray, "n"],
) -> Float32[ndarray, "n 24"]:
    """Rows of the surface table of one wall of each building.

    Args:
        width: of the wall.
        origin, heading: of its lower left corner, seen from outside, and of the way to the right one.
        paint: of the buildings.
        seed: of the building's textures; ``side`` tells its walls apart.
        front: whether it faces the street, and so has the shop.
        blank: whether it has no windows, as one that a neighbour adjoins.
    """
    bay_m = np.select([b.window == RIBBON, b.window == CURTAIN], [3.2, 1.7], 2.5 + 0.9 * seed)
    use = np.where(front, b.use, np.where(b.use == OFFICE, OFFICE, HOME))
    bays = np.maximum(1, np.round(width / bay_m))
    colour, door, trim = paint
    return surface_rows(
        Kind.FACADE, len(b), seed=(seed * 4 + side) / 4 % 1.0, colour=colour, second=door, origin=origin,
        heading=heading,
        parameters=(
            width, b.size[:, 2], b.ground, b.storeys, bays, use, b.window, b.wall, blank | (width < BLANK_M), trim
        ),
    )  # fmt: skip


def shaped_mesh(
    outlines: Sequence[Polygon],
    b: Buildings,
    paint: Paint,
    seed: Float64[ndarray, "n"],
) -> Mesh:
    """Buildings with a wall along each side of their outline, courtyards included, and a flat roof.

    Args:
        outlines: metres, outer rings counter-clockwise and inner ones clockwise.
        b: one for each outline.
        paint, seed: as for :func:`wall_rows`.
    """
    if not outlines:
        return Mesh.empty()
    rings = [(i, ring) for i, outline in enumerate(outlines) for ring in (outline.exterior, *outline.interiors)]
    corners = [np.asarray(ring.coords) for _, ring in rings]
    owner = np.concatenate([np.full(len(ring) - 1, i) for (i, _), ring in zip(rings, corners, strict=True)])
    start, end = (np.concatenate([ring[part] for ring in corners]) for part in (slice(-1), slice(1, None)))
    walls = b.some(owner)
    low, high = walls.position[:, 2], walls.position[:, 2] + walls.size[:, 2]
    faces = np.stack([np.column_stack(p) for p in ((start, low), (end, low), (end, high), (start, high))], 1)
    along = end - start
    colour, door, trim = paint
    heading = np.arctan2(along[:, 1], along[:, 0])
    rows = wall_rows(
        walls, np.hypot(*along.T), faces[:, 0], heading, (colour[owner], door[owner], trim[owner]), seed[owner],
        side=np.arange(len(owner)) % 4, front=np.cos(heading - walls.heading) > np.cos(FRONT_RAD),
        blank=np.zeros(len(owner), bool),
    )  # fmt: skip
    gravel = surface_rows(
        Kind.ROOF, len(b), seed=seed, colour=GRAVEL, origin=b.position, heading=b.heading, parameters=(1.0,)
    )
    tops = zip(outlines, b.position[:, 2] + b.size[:, 2], gravel, strict=True)
    roofs = [flat(outline, float(z), row[None]) for outline, z, row in tops]
    return Mesh.join([instances(quads(faces), rows), *roofs])
