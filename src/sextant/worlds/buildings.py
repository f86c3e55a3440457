"""Buildings of a town: walls, roofs and what projects from them, for many buildings at once."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from shapely import Polygon

from sextant.worlds.building_design import FLAT, GABLE, HIP, MANSARD, Buildings, design, footprints
from sextant.worlds.building_details import details
from sextant.worlds.mesh import Mesh, instances, place, quads
from sextant.worlds.roofs import roofs
from sextant.worlds.surfaces import palette
from sextant.worlds.walls import Paint, shaped_mesh, wall_rows

__all__ = ["FLAT", "GABLE", "HIP", "MANSARD", "Buildings", "building_mesh", "design", "footprints"]

#: colours of walls by their material, of trims and doors, and of roofs
PLASTER_COLOURS = palette(
    "#efe6d2", "#e8d3a8", "#dcb98a", "#e3c9b5", "#f1efe8", "#c9d2cf",
    "#d9a58a", "#b9c4a6", "#e9dfc0", "#c98f6b", "#d8d4c8", "#aab7c4",
)  # fmt: skip
BRICK_COLOURS = palette("#8a5646", "#9b6650", "#7a5347", "#ab8163", "#6b4a40", "#bfa485")
STONE_COLOURS = palette("#c8bda4", "#b7ad98", "#d6cdb8", "#a39d92")
PANEL_COLOURS = palette("#b9bcbd", "#8e9599", "#d5d6d3", "#6f777d", "#a8a294", "#c5b8a5")
BOARD_COLOURS = palette("#8f4a3e", "#d9d2b8", "#66747f", "#e8e4da", "#7d8a6a", "#c79a4f", "#4e5a52")
TRIM_COLOURS = palette("#f4f1e8", "#e2d9c4", "#cfc7b6", "#8a7a66")
DOOR_COLOURS = palette("#5b2f22", "#23402f", "#2a3f5f", "#6d1f1f", "#7a5a35", "#30302e", "#8c8f8a", "#3f5e6d")
TILE_COLOURS = palette("#9c4f35", "#8a4630", "#7a3f2f", "#5b5553", "#4a4d52", "#6c5b4e", "#a8623f")
#: by the style of the wall: PLASTER, BRICK, STONE, PANELS, BOARDS
WALL_COLOURS = (PLASTER_COLOURS, BRICK_COLOURS, STONE_COLOURS, PANEL_COLOURS, BOARD_COLOURS)


def building_mesh(
    b: Buildings,
    repaint: Bool[ndarray, "n"],
    change_seed: int,
    *,
    fine: bool = True,
    shapes: Mapping[int, Polygon] | None = None,
) -> Mesh:
    """Triangles of all buildings; those in ``repaint`` get new colours, windows and shops.

    Without ``fine``, details that a small picture cannot show are left out: sides of balconies, tops of chimneys.

    Args:
        shapes: outlines of the buildings that are no rectangles, by their number; their roofs are flat.
    """
    if not len(b):
        return Mesh.empty()
    before = np.random.default_rng([7, len(b)]).random((8, len(b)))
    after = np.random.default_rng([8, change_seed]).random((8, len(b)))
    style = np.where(repaint, after, before)
    seed = np.where(repaint, after[7], b.seed)
    colour = np.stack([_drawn(table, style[0]) for table in WALL_COLOURS])[b.wall, np.arange(len(b))]
    colour = colour * (0.88 + 0.2 * style[1])[:, None]
    tile = _drawn(TILE_COLOURS, style[5]) * (0.85 + 0.3 * style[6])[:, None]
    paint = (colour, _drawn(DOOR_COLOURS, style[3]), style[2])
    shapes = shapes or {}
    shaped = np.array(sorted(shapes), np.int64)
    square = np.delete(np.arange(len(b)), shaped)
    some = b.some(square)
    return Mesh.join([
        _walls(some, _of(paint, square), seed[square]),
        roofs(some, tile[square], seed[square]),
        details(some, colour[square], _drawn(TRIM_COLOURS, style[2])[square], seed[square], fine=fine),
        shaped_mesh([shapes[i] for i in shaped.tolist()], b.some(shaped), _of(paint, shaped), seed[shaped]),
    ])  # fmt: skip


def _drawn(table: Float64[ndarray, "k 3"], draw: Float64[ndarray, "n"]) -> Float64[ndarray, "n 3"]:
    """Colours of a table, picked by numbers in [0, 1)."""
    return np.asarray(table[(draw * len(table)).astype(int)])


def _of(paint: Paint, rows: Int64[ndarray, "k"]) -> Paint:
    colour, door, trim = paint
    return colour[rows], door[rows], trim[rows]


def _walls(b: Buildings, paint: Paint, seed: Float64[ndarray, "n"]) -> Mesh:
    """Four walls per building: front, right, back, left; gables reach up to the ridge."""
    w, d, h = b.size.T
    starts = b.outline
    ends = np.roll(starts, -1, axis=1)
    level, nobody = np.zeros(len(b)), np.zeros(len(b), bool)
    attached = (nobody, b.attached[:, 1], nobody, b.attached[:, 0])
    meshes = []
    for side, width in enumerate((w, d, w, d)):
        gabled = (b.roof == GABLE) & (b.across == (side % 2 == 0))
        start, end = starts[:, side], ends[:, side]
        corners = np.stack(
            [np.column_stack([xy, z]) for xy, z in ((start, level), (end, level), (end, h), (start, h))], 1
        )
        peak = np.column_stack([0.5 * (start + end), h + np.where(gabled, b.rise, 0.0)])
        top = np.stack([corners[:, 3], corners[:, 2], peak], 1)
        placed = place(np.concatenate([quads(corners), top[:, None]], 1), b.position, b.heading)
        rows = wall_rows(
            b, width, placed[:, 0, 0], b.heading + side * np.pi / 2, paint, seed,
            side=side, front=np.full(len(b), side == 0), blank=attached[side],
        )  # fmt: skip
        meshes.append(instances(placed[:, :2], rows))
        meshes.append(instances(placed[gabled, 2:], rows[gabled]))
    return Mesh.join(meshes)
