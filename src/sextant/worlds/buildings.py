"""Buildings of a town: walls, roofs and what sticks out of them, for many buildings at once."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from sextant.worlds.mesh import Mesh, boxes, instances, place, quads
from sextant.worlds.shading.facade import (
    BOARDS,
    BRICK,
    CURTAIN,
    FRENCH,
    GARAGE,
    HOME,
    OFFICE,
    PANELS,
    PLASTER,
    RIBBON,
    SASH,
    SHOP,
    SQUARE,
    STONE,
)
from sextant.worlds.surfaces import Kind, palette, surface_rows

FLAT, GABLE, HIP, MANSARD = range(4)
#: colours of walls by what they are made of, of trims and doors, of roofs
PLASTER_COLOURS = palette(
    "#efe6d2",
    "#e8d3a8",
    "#dcb98a",
    "#e3c9b5",
    "#f1efe8",
    "#c9d2cf",
    "#d9a58a",
    "#b9c4a6",
    "#e9dfc0",
    "#c98f6b",
    "#d8d4c8",
    "#aab7c4",
)
BRICK_COLOURS = palette("#8a5646", "#9b6650", "#7a5347", "#ab8163", "#6b4a40", "#bfa485")
STONE_COLOURS = palette("#c8bda4", "#b7ad98", "#d6cdb8", "#a39d92")
PANEL_COLOURS = palette("#b9bcbd", "#8e9599", "#d5d6d3", "#6f777d", "#a8a294", "#c5b8a5")
BOARD_COLOURS = palette("#8f4a3e", "#d9d2b8", "#66747f", "#e8e4da", "#7d8a6a", "#c79a4f", "#4e5a52")
TRIM_COLOURS = palette("#f4f1e8", "#e2d9c4", "#cfc7b6", "#8a7a66")
DOOR_COLOURS = palette("#5b2f22", "#23402f", "#2a3f5f", "#6d1f1f", "#7a5a35", "#30302e", "#8c8f8a", "#3f5e6d")
TILE_COLOURS = palette("#9c4f35", "#8a4630", "#7a3f2f", "#5b5553", "#4a4d52", "#6c5b4e", "#a8623f")


@dataclass(frozen=True)
class Buildings:
    """Many buildings, one array an attribute. In the frame of a building x runs along its street, y away from it.

    Attributes:
        position: middle of the footprint on the ground, metres.
        heading: direction of x, radians.
        size: width along the street, depth, height of the walls.
        roof: FLAT, GABLE, HIP or MANSARD.
        rise: height of the roof above the walls.
        across: the ridge runs away from the street.
        storeys, ground: number of storeys and height of the lowest.
        use: of the ground storey (HOME, SHOP, GARAGE, OFFICE).
        window, wall: style of windows and walls.
        attached: whether a neighbour stands wall to wall on the left (-x) and on the right.
        seed: in [0, 1).
    """

    position: Float64[ndarray, "n 3"]
    heading: Float64[ndarray, "n"]
    size: Float64[ndarray, "n 3"]
    roof: Int64[ndarray, "n"]
    rise: Float64[ndarray, "n"]
    across: Bool[ndarray, "n"]
    storeys: Int64[ndarray, "n"]
    ground: Float64[ndarray, "n"]
    use: Int64[ndarray, "n"]
    window: Int64[ndarray, "n"]
    wall: Int64[ndarray, "n"]
    attached: Bool[ndarray, "n 2"]
    seed: Float64[ndarray, "n"]

    def __len__(self) -> int:
        return len(self.position)


def design(
    position: Float64[ndarray, "n 3"],
    heading: Float64[ndarray, "n"],
    footprint: Float64[ndarray, "n 2"],
    density: Float64[ndarray, "n"],
    attached: Bool[ndarray, "n 2"],
    terraced: Bool[ndarray, "n"],
    rng: np.random.Generator,
) -> Buildings:
    """Buildings drawn for footprints: taller, with shops, where ``density`` (0 to 1) is high; houses where it is low."""
    n = len(position)
    draw = rng.random((12, n))
    office = (density > 0.72) & (draw[0] < 0.3)
    dense = density > 0.45
    storeys = np.where(dense, 2 + np.floor(4.4 * density * draw[1] + 0.8), 1 + np.floor(1.75 * draw[1] + 0.35)).astype(
        np.int64
    )
    storeys = np.where(office, 4 + np.floor(5 * draw[1]).astype(np.int64), storeys)
    use = np.where(draw[2] < np.clip(1.5 * density - 0.4, 0, 0.85), SHOP, np.where(draw[2] > 0.8, GARAGE, HOME))
    use = np.where(office, OFFICE, use)
    ground = np.where((use == SHOP) | (use == OFFICE), 3.6 + 0.8 * draw[3], 2.8 + 0.4 * draw[3])
    storey_height = np.where(office, 3.4, 2.75 + 0.55 * draw[4])
    walls = np.where(
        dense,
        np.select([draw[5] < 0.55, draw[5] < 0.78, draw[5] < 0.93], [PLASTER, BRICK, STONE], PANELS),
        np.select([draw[5] < 0.5, draw[5] < 0.75], [PLASTER, BRICK], BOARDS),
    )
    walls = np.where(office, np.where(draw[5] < 0.7, PANELS, STONE), walls)
    window = np.where(
        dense,
        np.select([draw[6] < 0.4, draw[6] < 0.65], [SASH, FRENCH], SQUARE),
        np.select([draw[6] < 0.35], [SASH], SQUARE),
    )
    window = np.where(office, np.where(draw[6] < 0.55, RIBBON, CURTAIN), window)
    roof = np.where(
        dense,
        np.select([draw[7] < 0.4, draw[7] < 0.62, draw[7] < 0.8], [GABLE, MANSARD, HIP], FLAT),
        np.select([draw[7] < 0.62, draw[7] < 0.92], [GABLE, HIP], FLAT),
    )
    roof = np.where(office | (storeys > 5), FLAT, roof)
    across = ~terraced & (draw[8] < 0.35)
    span = np.where(across, footprint[:, 0], footprint[:, 1])
    rise = np.select(
        [roof == FLAT, roof == MANSARD], [0.0, 2.3 + 0.5 * draw[9]], np.clip(span * (0.26 + 0.16 * draw[9]), 1.2, 5.5)
    )
    height = ground + (storeys - 1) * storey_height + np.where(storeys > 1, 0.35, 0.25)
    size = np.stack([footprint[:, 0], footprint[:, 1], height], -1)
    return Buildings(
        position, heading, size, roof, rise, across, storeys, ground, use, window, walls, attached, draw[10]
    )


def building_mesh(b: Buildings, repaint: Bool[ndarray, "n"], change_seed: int, *, fine: bool = True) -> Mesh:
    """Triangles of all buildings; those in ``repaint`` get other colours, windows and shops than they had.

    ``fine`` false leaves out what a small picture does not show: the sides of balconies, tops of chimneys.
    """
    if not len(b):
        return Mesh.empty()
    base = np.random.default_rng([7, len(b)]).random((8, len(b)))
    other = np.random.default_rng([8, change_seed]).random((8, len(b)))
    style = np.where(repaint, other, base)
    seed = np.where(repaint, other[7], b.seed)
    colours = [PLASTER_COLOURS, BRICK_COLOURS, STONE_COLOURS, PANEL_COLOURS, BOARD_COLOURS]
    colour = np.stack([table[(style[0] * len(table)).astype(int)] for table in colours])[b.wall, np.arange(len(b))]
    colour = colour * (0.88 + 0.2 * style[1])[:, None]
    trim = TRIM_COLOURS[(style[2] * len(TRIM_COLOURS)).astype(int)]
    door = DOOR_COLOURS[(style[3] * len(DOOR_COLOURS)).astype(int)]
    tile = TILE_COLOURS[(style[5] * len(TILE_COLOURS)).astype(int)] * (0.85 + 0.3 * style[6])[:, None]
    parts = [
        _walls(b, colour, door, style[2], seed),
        _roofs(b, tile, colour, seed),
        _details(b, colour, trim, seed, fine),
    ]
    return Mesh.join(parts)


def _walls(
    b: Buildings,
    colour: Float64[ndarray, "n 3"],
    second: Float64[ndarray, "n 3"],
    trim: Float64[ndarray, "n"],
    seed: Float64[ndarray, "n"],
) -> Mesh:
    """Four walls a building: front, right, back, left; gables reach up to the ridge."""
    w, d, h = b.size.T
    gable = (b.roof == GABLE).astype(float) * b.rise
    starts = np.stack(
        [
            np.stack([-w / 2, -d / 2], -1),
            np.stack([w / 2, -d / 2], -1),
            np.stack([w / 2, d / 2], -1),
            np.stack([-w / 2, d / 2], -1),
        ],
        1,
    )
    ends = np.roll(starts, -1, axis=1)
    width = np.stack([w, d, w, d], 1)
    meshes = []
    for side in range(4):
        peak = np.where(b.across == (side % 2 == 0), gable, 0.0)
        s, e = starts[:, side], ends[:, side]
        zero, middle = np.zeros(len(b)), 0.5 * (s + e)
        corners = np.stack([
            np.column_stack([s, zero]), np.column_stack([e, zero]), np.column_stack([e, h]), np.column_stack([s, h])
        ], 1)  # fmt: skip
        top = np.stack([corners[:, 3], corners[:, 2], np.column_stack([middle, h + peak])], 1)
        triangles = np.concatenate([quads(corners), top[:, None]], 1)
        placed = place(triangles, b.position, b.heading)
        party = b.attached[:, 0] if side == 3 else (b.attached[:, 1] if side == 1 else np.zeros(len(b), bool))
        small = width[:, side] < 2.2
        bays = np.maximum(
            1,
            np.round(
                width[:, side] / np.select([b.window == RIBBON, b.window == CURTAIN], [3.2, 1.7], 2.5 + 0.9 * seed)
            ),
        )
        shown = np.where(side == 0, b.use, np.where(b.use == OFFICE, OFFICE, HOME))
        rows = surface_rows(
            Kind.FACADE, len(b), seed=(seed * 4 + side) / 4 % 1.0, colour=colour, second=second,
            origin=placed[:, 0, 0], heading=b.heading + side * np.pi / 2,
            parameters=(width[:, side], h, b.ground, b.storeys, bays, shown, b.window, b.wall, np.where(party | small, 1.0, 0.0), trim),
        )  # fmt: skip
        meshes.append(instances(placed[:, :2], rows))
        meshes.append(instances(placed[peak > 0, 2:], rows[peak > 0]))
    return Mesh.join(meshes)


def _roofs(
    b: Buildings, tile: Float64[ndarray, "n 3"], colour: Float64[ndarray, "n 3"], seed: Float64[ndarray, "n"]
) -> Mesh:
    """Roofs of every form; the frame is turned so that the ridge runs along local x."""
    parts = []
    turn = np.where(b.across, np.pi / 2, 0.0)
    length = np.where(b.across, b.size[:, 1], b.size[:, 0])
    span = np.where(b.across, b.size[:, 0], b.size[:, 1])
    for form in (FLAT, GABLE, HIP, MANSARD):
        at = np.flatnonzero(b.roof == form)
        if not len(at):
            continue
        l, s, h, rise = length[at], span[at], b.size[at, 2], b.rise[at]
        zero, o = np.zeros(len(at)), 0.0 if form in (FLAT, MANSARD) else 0.42
        joined = b.attached[at] & ~b.across[at, None]
        end0, end1 = np.where(joined[:, 0], 0.0, o), np.where(joined[:, 1], 0.0, o)
        end = np.where(b.attached[at], 0.0, o)
        heading = b.heading[at] + turn[at]

        def p(x: object, y: object, z: object, n: int = len(at)) -> Float64[ndarray, "n 3"]:
            return np.stack([np.broadcast_to(np.asarray(v, float), n) for v in (x, y, z)], -1)

        faces: list[Float64[ndarray, "n 4 3"]] = []
        if form == FLAT:
            faces = [np.stack([p(-l / 2, -s / 2, h), p(l / 2, -s / 2, h), p(l / 2, s / 2, h), p(-l / 2, s / 2, h)], 1)]
        elif form == MANSARD:
            i = 0.32 * rise
            low = [p(-l / 2, -s / 2, h), p(l / 2, -s / 2, h), p(l / 2, s / 2, h), p(-l / 2, s / 2, h)]
            x0, x1 = -l / 2 + np.where(joined[:, 0], 0.0, i), l / 2 - np.where(joined[:, 1], 0.0, i)
            high = [
                p(x0, -s / 2 + i, h + rise),
                p(x1, -s / 2 + i, h + rise),
                p(x1, s / 2 - i, h + rise),
                p(x0, s / 2 - i, h + rise),
            ]
            faces = [np.stack([low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]], 1) for k in range(4)]
            ridge = np.stack([p(x0, zero, h + rise + 0.5), p(x1, zero, h + rise + 0.5)], 1)
            faces.append(np.stack([high[0], high[1], ridge[:, 1], ridge[:, 0]], 1))
            faces.append(np.stack([high[2], high[3], ridge[:, 0], ridge[:, 1]], 1))
            faces.append(np.stack([high[1], high[2], ridge[:, 1], ridge[:, 1]], 1))
            faces.append(np.stack([high[3], high[0], ridge[:, 0], ridge[:, 0]], 1))
        else:
            slope = rise / (s / 2)
            eave = h - slope * o
            hip = np.minimum(s / 2, 0.42 * l)
            in0, in1 = np.where(joined[:, 0], 0.0, hip), np.where(joined[:, 1], 0.0, hip)
            a, c = p(-l / 2 - end0, -s / 2 - o, eave), p(l / 2 + end1, -s / 2 - o, eave)
            d, e = p(l / 2 + end1, s / 2 + o, eave), p(-l / 2 - end0, s / 2 + o, eave)
            r0 = p(-l / 2 - (end0 if form == GABLE else -in0), zero, h + rise)
            r1 = p(l / 2 + (end1 if form == GABLE else -in1), zero, h + rise)
            faces = [np.stack([a, c, r1, r0], 1), np.stack([d, e, r0, r1], 1)]
            if form == HIP:
                faces += [np.stack([c, d, r1, r1], 1), np.stack([e, a, r0, r0], 1)]
            drop = np.array([0.0, 0.0, -0.2])
            for low, high in ((a, c), (d, e), (r0, a), (c, r1), (r1, d), (e, r0)):  # the edges of the roof
                faces.append(np.stack([low + drop, high + drop, high, low], 1))
            faces.append(np.stack([c + drop, a + drop, p(-l / 2, -s / 2, h - 0.2), p(l / 2, -s / 2, h - 0.2)], 1))
            faces.append(np.stack([e + drop, d + drop, p(l / 2, s / 2, h - 0.2), p(-l / 2, s / 2, h - 0.2)], 1))
        triangles = quads(np.stack(faces, 1)).reshape(len(at), -1, 3, 3)
        areas = np.linalg.norm(
            np.cross(triangles[:, :, 1] - triangles[:, :, 0], triangles[:, :, 2] - triangles[:, :, 0]), axis=-1
        )
        placed = place(
            triangles[:, (areas > 0).any(0)], b.position[at], heading
        )  # a triangular end is a quad of which half is nothing
        shingle = np.where((form == MANSARD), np.array([0.09, 0.095, 0.105]), tile[at])
        grey = np.broadcast_to(np.array([0.21, 0.205, 0.2]), (len(at), 3))
        rows = surface_rows(
            Kind.ROOF, len(at), seed=seed[at], colour=grey if form == FLAT else shingle,
            origin=b.position[at] + np.column_stack([zero, zero, h]), heading=heading, parameters=(1.0 if form == FLAT else 0.0,),
        )  # fmt: skip
        parts.append(instances(placed, rows))
    return Mesh.join(parts)


def _beside(b: Buildings, at: Int64[ndarray, "k"], offset: Float64[ndarray, "k 3"]) -> Float64[ndarray, "k 3"]:
    """World places of points given in the frames of buildings ``at``."""
    c, s = np.cos(b.heading[at]), np.sin(b.heading[at])
    x, y, z = offset.T
    return b.position[at] + np.stack([c * x - s * y, s * x + c * y, z], -1)


def _boxes(
    b: Buildings,
    at: Int64[ndarray, "k"],
    offset: object,
    size: object,
    colour: object,
    kind: Kind = Kind.PLAIN,
    gloss: float = 0.0,
) -> Mesh:
    """A box on each of the buildings ``at``; ``offset`` and ``size`` are triples of scalars or ``(k,)``."""
    k = len(at)
    if not k:
        return Mesh.empty()
    where = np.stack([np.broadcast_to(np.asarray(v, float), k) for v in offset], -1)  # type: ignore[attr-defined]
    extent = np.stack([np.broadcast_to(np.asarray(v, float), k) for v in size], -1)  # type: ignore[attr-defined]
    base = _beside(b, at, where)
    rows = surface_rows(
        kind, k, seed=b.seed[at], colour=colour, origin=base, heading=b.heading[at], parameters=(gloss,)
    )
    return boxes(base, extent, b.heading[at], rows, bottom=True)


def _details(
    b: Buildings,
    colour: Float64[ndarray, "n 3"],
    trim: Float64[ndarray, "n 3"],
    seed: Float64[ndarray, "n"],
    fine: bool,
) -> Mesh:
    """Chimneys, parapets, cornices, dormers, balconies, awnings and steps: what gives a street its silhouette."""
    w, d, h = b.size.T
    n = np.arange(len(b))
    pick = np.random.default_rng([9, len(b)]).random((6, len(b)))
    parts: list[Mesh] = []

    pitched = n[(b.roof != FLAT) & (pick[0] < 0.7)]
    top = h + b.rise
    side = np.where(pick[1] < 0.5, -1.0, 1.0)
    parts.append(
        _boxes(
            b,
            pitched,
            (side[pitched] * 0.3 * w[pitched], 0.12 * d[pitched], h[pitched]),
            (0.55, 0.75, 0.9 + b.rise[pitched]),
            (0.25, 0.12, 0.08),
        )
    )
    if fine:
        parts.append(
            _boxes(
                b,
                pitched,
                (side[pitched] * 0.3 * w[pitched], 0.12 * d[pitched], top[pitched] + 0.9),
                (0.3, 0.3, 0.3),
                (0.3, 0.14, 0.09),
            )
        )

    flat = n[b.roof == FLAT]
    wall = colour[flat] * 0.92
    for x, y, sx, sy in ((0, -1, 1, 0), (0, 1, 1, 0), (-1, 0, 0, 1), (1, 0, 0, 1)):
        size = (np.where(sx, w[flat], 0.25), np.where(sy, d[flat] - 0.5, 0.25), 0.55)
        parts.append(
            _boxes(b, flat, (x * (w[flat] / 2 - 0.125), y * (d[flat] / 2 - 0.125), h[flat] - 0.02), size, wall)
        )
    plant = flat[pick[2, flat] < 0.5]
    parts.append(
        _boxes(
            b,
            plant,
            (side[plant] * 0.2 * w[plant], 0.1 * d[plant], h[plant]),
            (0.3 * w[plant], 0.3 * d[plant], 1.9),
            (0.4, 0.41, 0.42),
        )
    )

    cornice = n[((b.roof == FLAT) | (b.roof == MANSARD)) & (b.window != CURTAIN) & (b.storeys > 1)]
    parts.append(
        _boxes(
            b, cornice, (0.0, -d[cornice] / 2 - 0.14, h[cornice] - 0.32), (w[cornice] + 0.02, 0.34, 0.3), trim[cornice]
        )
    )
    band = n[(b.use == SHOP) & (b.storeys > 1)]
    parts.append(_boxes(b, band, (0.0, -d[band] / 2 - 0.07, b.ground[band] - 0.16), (w[band], 0.2, 0.16), trim[band]))

    mansard = n[b.roof == MANSARD]
    for k in range(5):  # a dormer over each bay
        bays = np.maximum(1, np.round(w / (2.5 + 0.9 * seed)))
        at = mansard[(k < bays[mansard])]
        x = (k + 0.5) * (w / bays)[at] - w[at] / 2
        parts.append(_dormers(b, at, x, -d[at] / 2 + 0.34, h[at] + 0.25, colour[at], seed[at]))
    gable = n[(b.roof == GABLE) & ~b.across & (pick[3] < 0.4) & (b.rise > 2.4)]
    for x in (-0.25, 0.25):
        slope = b.rise[gable] / (d[gable] / 2)
        y = -d[gable] / 2 + 0.7
        parts.append(_dormers(b, gable, x * w[gable], y, h[gable] + slope * 0.7 - 0.45, colour[gable], seed[gable]))

    tall = n[(b.window == FRENCH) & (b.storeys > 1)]
    for storey in range(1, 5):
        bays = np.maximum(1, np.round(w / (2.5 + 0.9 * seed)))
        height = (h - b.ground) / np.maximum(b.storeys - 1, 1)
        for k in range(4):
            at = tall[(storey < b.storeys[tall]) & (k < bays[tall]) & ((k + storey * (seed[tall] > 0.5)) % 2 == 0)]
            x, z = (k + 0.5) * (w / bays)[at] - w[at] / 2, b.ground[at] + (storey - 1) * height[at]
            wide = np.minimum(1.9, 0.8 * (w / bays)[at])
            parts.append(_boxes(b, at, (x, -d[at] / 2 - 0.45, z), (wide, 0.9, 0.12), (0.42, 0.41, 0.39)))
            parts.append(
                _boxes(b, at, (x, -d[at] / 2 - 0.88, z + 0.12), (wide, 0.04, 0.9), (0.05, 0.05, 0.055), Kind.FENCE)
            )
            for end in (-0.5, 0.5) if fine else ():
                parts.append(
                    _boxes(
                        b,
                        at,
                        (x + end * wide, -d[at] / 2 - 0.45, z + 0.12),
                        (0.04, 0.88, 0.9),
                        (0.05, 0.05, 0.055),
                        Kind.FENCE,
                    )
                )

    shade = n[(b.use == SHOP) & (pick[4] < 0.45)]
    parts.append(_awnings(b, shade))
    return Mesh.join(parts)


def _dormers(
    b: Buildings,
    at: Int64[ndarray, "k"],
    x: Float64[ndarray, "k"],
    y: Float64[ndarray, "k"],
    z: Float64[ndarray, "k"],
    colour: Float64[ndarray, "k 3"],
    seed: Float64[ndarray, "k"],
) -> Mesh:
    """Windows that stand out of a roof: a box with one bay of facade in front and a little roof."""
    k = len(at)
    if not k:
        return Mesh.empty()
    base = _beside(b, at, np.stack([x, y + 0.9, z], -1))
    size = np.broadcast_to(np.array([1.25, 2.0, 1.75]), (k, 3))
    corner = _beside(b, at, np.stack([x - 0.625, y - 0.1, z - 0.55], -1))
    rows = surface_rows(
        Kind.FACADE, k, seed=seed, colour=colour, second=0.8 * colour, origin=corner, heading=b.heading[at],
        parameters=(1.25, 2.3, 2.3, 1.0, 1.0, GARAGE, SQUARE, PLASTER, 0.0, 0.0),
    )  # fmt: skip
    rows[:, 13 + 4] = 1.0
    body = boxes(base, size, b.heading[at], rows)
    top = surface_rows(Kind.PLAIN, k, colour=(0.11, 0.11, 0.12))
    cover = boxes(base + np.array([0, 0, 1.75]), size * np.array([1.15, 1.05, 0.06]), b.heading[at], top, bottom=True)
    return Mesh.join([body, cover])


def _awnings(b: Buildings, at: Int64[ndarray, "k"]) -> Mesh:
    """Cloth over a shop window."""
    k = len(at)
    if not k:
        return Mesh.empty()
    w, d, g = b.size[at, 0] - 0.5, b.size[at, 1], b.ground[at] - 0.95
    back, front = -d / 2, -d / 2 - 1.25
    corners = np.stack([
        np.stack([-w / 2, front, g - 0.65], -1), np.stack([w / 2, front, g - 0.65], -1), np.stack([w / 2, back, g], -1), np.stack([-w / 2, back, g], -1)
    ], 1)  # fmt: skip
    hem = np.stack([corners[:, 0] - [0, 0, 0.22], corners[:, 1] - [0, 0, 0.22], corners[:, 1], corners[:, 0]], 1)
    triangles = place(quads(np.stack([corners, hem], 1)).reshape(k, -1, 3, 3), b.position[at], b.heading[at])
    colours = palette("#8e2b25", "#2f5d46", "#2c4a73", "#b5702a", "#6b2d52", "#3c3c3c")
    rows = surface_rows(
        Kind.AWNING, k, seed=b.seed[at], colour=colours[(b.seed[at] * 6).astype(int)], second=(0.75, 0.73, 0.66),
        origin=b.position[at], heading=b.heading[at], parameters=(w,),
    )  # fmt: skip
    return instances(triangles, rows)


def footprints(b: Buildings) -> Float32[ndarray, "n 4 2"]:
    """Corners of the footprints, for maps and for keeping things out of houses."""
    w, d = b.size[:, 0], b.size[:, 1]
    corners = np.stack([np.stack([sx * w / 2, sy * d / 2], -1) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))], 1)
    c, s = np.cos(b.heading)[:, None], np.sin(b.heading)[:, None]
    turned = np.stack([c * corners[..., 0] - s * corners[..., 1], s * corners[..., 0] + c * corners[..., 1]], -1)
    return (turned + b.position[:, None, :2]).astype(np.float32)
