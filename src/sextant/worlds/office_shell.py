"""Walls, floors, ceilings, doors and windows of a floor plan as triangles.

Every room is a closed box of quadrilaterals that face inwards, joined to its neighbours by the tunnels of the doorways.
A hull around the whole building closes it: no ray can leave.
"""

import itertools

import numpy as np
import shapely
from jaxtyping import Float
from numpy import ndarray

from sextant.worlds.mesh import Mesh, instances, quads
from sextant.worlds.office_lights import lattice
from sextant.worlds.office_parts import FILLS, Frame, Parts, Point
from sextant.worlds.office_plan import (
    CEILING_M,
    HEAD_M,
    OUTER_WALL_M,
    SILL_M,
    Doorway,
    FloorPlan,
    Room,
    RoomKind,
    Side,
    Window,
)
from sextant.worlds.surfaces import Kind, linear, palette, surface_rows

#: depth of window niches, height of skirting boards, width and thickness of door frames, metres
NICHE_M, SKIRTING_M, FRAME_M, LEAF_M = 0.18, 0.09, 0.07, 0.04
PALE = palette("#efece4", "#f1efe9", "#ece9df", "#eeeeea")
CEILING_COLOUR, SKIRTING, FRAME = linear("#f3f2ee"), linear("#b9b4a8"), linear("#cfcac0")
DOORS = palette("#c9a877", "#b98f5c", "#d8d5cc", "#7f99a8")
#: kind of floor (0 carpet, 1 tiles, 2 planks, 3 linoleum) and its colours
FLOORS: dict[RoomKind, tuple[int, Float[ndarray, "n 3"]]] = {
    RoomKind.CORRIDOR: (3, palette("#9c9a92", "#8f9a9c", "#a39a8a")),
    RoomKind.HALL: (1, palette("#b9b4aa")),
    RoomKind.OFFICE: (0, palette("#5f6a75", "#6d6a63", "#56707a")),
    RoomKind.LAB: (3, palette("#9aa3a0")),
    RoomKind.KITCHEN: (1, palette("#c4beb2", "#a7adad")),
    RoomKind.MEETING: (2, palette("#a97b4d", "#9a6f48")),
    RoomKind.STORE: (3, palette("#8c8a85")),
}
Rect = tuple[float, float, float, float]  # from and to along the wall; from and to above the floor


def shell(plan: FloorPlan, seed: int, fills: list[Point]) -> Mesh:
    """The empty building, in the frame of the plan."""
    rng = np.random.default_rng([seed, 61])
    parts = Parts()
    style = int(rng.integers(len(PALE)))
    corridor_floor = int(rng.integers(3))
    faces = [
        _room(
            plan,
            number,
            PALE[style if rng.random() < 0.7 else int(rng.integers(len(PALE)))],
            corridor_floor,
            float(rng.random()),
            fills[number],
        )
        for number in range(len(plan.rooms))
    ]
    colour = DOORS[int(rng.integers(len(DOORS)))]
    for door in plan.doors:
        faces.append(_tunnel(plan, door, PALE[style], fills))
        _door(parts, plan, door, colour, float(rng.random()), fills)
    for window in plan.windows:
        room = plan.rooms[window.room]
        faces.append(_niche(room, window, PALE[style], fills[window.room]))
        frame = wall_frame(room, window.side, (window.start + window.end) / 2, fills[window.room])
        wide = window.end - window.start
        parts.box(frame, (0, 0.0, SILL_M - 0.035), (wide + 0.12, 0.16, 0.03), linear("#dcd8cf"), gloss=0.3)
    return Mesh.join([*faces, parts.mesh(), _hull(plan)])


def wall_frame(room: Room, side: Side, s: float, fills: Point) -> Frame:
    """The frame of something that stands ``s`` metres along a wall, with its back to it."""
    x, y = room.start(side)
    dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[side]
    return Frame(x + s * dx, y + s * dy, float(side) * np.pi / 2, fills)


def opening(room: Room, door: Doorway, side: Side) -> tuple[float, float]:
    """The position of a doorway along a wall, metres from its start."""
    x0, y0, x1, y1 = room.box
    a, b, c, d = door.box
    return ((a - x0, c - x0), (b - y0, d - y0), (x1 - c, x1 - a), (y1 - d, y1 - b))[side]


def doors_of(plan: FloorPlan, number: int) -> list[tuple[Doorway, Side]]:
    """The doorways of a room, and the wall that each is in."""
    found = []
    for door in plan.doors:
        if number == door.rooms[0]:
            found.append((door, door.side_of))
        elif number == door.rooms[1]:
            found.append((door, Side((door.side_of + 2) % 4)))
    return found


def _room(
    plan: FloorPlan, number: int, pale: Float[ndarray, "3"], corridor_floor: int, seed: float, fills: Point
) -> Mesh:
    room = plan.rooms[number]
    doors, windows = doors_of(plan, number), [w for w in plan.windows if w.room == number]
    wide_open = {side for door, side in doors if door.height > 2.6 and door.width > 0.9 * room.length(side)}
    meshes = []
    for side in Side:
        holes = [(*opening(room, door, side), 0.0, door.height) for door, where in doors if where == side]
        holes += [(w.start, w.end, SILL_M, HEAD_M) for w in windows if w.side == side]
        low, high = Side((side + 3) % 4) not in wide_open, Side((side + 1) % 4) not in wide_open
        row = surface_rows(
            Kind.WALL, 1, seed=(seed + 0.21 * side) % 1, colour=pale, second=SKIRTING, origin=(*room.start(side), 0.0),
            heading=side * np.pi / 2, parameters=(room.length(side), CEILING_M, SKIRTING_M, float(low), float(high)),
        )  # fmt: skip
        frame = wall_frame(room, side, 0.0, fills)
        pieces = [rect for rect in _pieces(room.length(side), holes) if rect[1] - rect[0] > 1e-6]
        if pieces:
            meshes.append(_upright(frame, pieces, row))
    mask = float(sum(1 << side for side in Side if side not in wide_open))
    kind, colours = FLOORS[room.kind]
    colour = colours[corridor_floor % len(colours) if room.kind is RoomKind.CORRIDOR else int(seed * 31) % len(colours)]
    columns, rows = lattice(room)
    x0, y0, x1, y1 = room.box
    floor = surface_rows(
        Kind.FLOOR,
        1,
        seed=seed,
        colour=colour,
        origin=(x0, y0, 0.0),
        parameters=(float(kind), room.width, room.depth, mask),
    )
    top = surface_rows(
        Kind.CEILING, 1, seed=seed, colour=CEILING_COLOUR, origin=(x0, y0, CEILING_M),
        parameters=(0.6, 1.0, room.width, room.depth, mask, float(columns), float(rows)),
    )  # fmt: skip
    meshes += [
        _level((x0, y0, x1, y1), 0.0, floor, up=True, fills=fills),
        _level((x0, y0, x1, y1), CEILING_M, top, up=False, fills=fills),
    ]
    return Mesh.join(meshes)


def _pieces(length: float, holes: list[Rect]) -> list[Rect]:
    """A wall without its openings, cut at their ends."""
    edges = sorted({0.0, length, *(min(max(x, 0.0), length) for hole in holes for x in hole[:2])})
    found = []
    for a, b in itertools.pairwise(edges):
        z = 0.0
        for hole in sorted((h for h in holes if h[0] < (a + b) / 2 < h[1]), key=lambda h: h[2]):
            if hole[2] > z:
                found.append((a, b, z, hole[2]))
            z = max(z, hole[3])
        if z < CEILING_M - 1e-6:
            found.append((a, b, z, CEILING_M))
    return found


def _upright(frame: Frame, rects: list[Rect], row: Float[ndarray, "1 24"]) -> Mesh:
    """Faces in a wall, seen from the room."""
    corners = []
    for a, b, low, high in rects:
        start, end = frame.at(a, 0.0), frame.at(b, 0.0)
        corners.append([(*start, low), (*start, high), (*end, high), (*end, low)])
    row[:, FILLS] = frame.fills
    return instances(quads(np.array(corners)).reshape(1, -1, 3, 3), row)


def _level(box: Rect, z: float, row: Float[ndarray, "1 24"], *, up: bool, fills: Point) -> Mesh:
    x0, y0, x1, y1 = box
    corners = np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)])
    row[:, FILLS] = fills
    return instances(quads(corners[None] if up else corners[None, ::-1]).reshape(1, 2, 3, 3), row)


def _tunnel(plan: FloorPlan, door: Doorway, pale: Float[ndarray, "3"], fills: list[Point]) -> Mesh:
    """The two jambs, the lintel and the threshold of a doorway."""
    x0, y0, x1, y1 = door.box
    here = fills[door.rooms[0]]
    joined = door.height > 2.6
    colour = pale if joined or door.leaf == "none" else np.array(FRAME)
    starts = [(x1, y0, 1), (x0, y1, 3)] if not door.across_x else [(x0, y0, 0), (x1, y1, 2)]
    thick = (y1 - y0) if not door.across_x else (x1 - x0)
    meshes = []
    for x, y, side in starts:
        frame = Frame(x, y, side * np.pi / 2, here)
        row = surface_rows(
            Kind.WALL, 1, seed=0.4, colour=colour, second=SKIRTING if joined else colour, origin=(x, y, 0.0),
            heading=side * np.pi / 2,
            parameters=(thick, CEILING_M if joined else door.height + 0.4, SKIRTING_M, 0.0, 0.0),
        )  # fmt: skip
        meshes.append(_upright(frame, [(0.0, thick, 0.0, door.height)], row))
    kind, colours = FLOORS[plan.rooms[door.rooms[0]].kind]
    if joined:
        floor = surface_rows(
            Kind.FLOOR, 1, seed=0.5, colour=colours[0], origin=(x0, y0, 0.0), parameters=(float(kind), 1.0, 1.0, 0.0)
        )
        top = surface_rows(
            Kind.CEILING,
            1,
            colour=CEILING_COLOUR,
            origin=(x0, y0, CEILING_M),
            parameters=(0.6, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0),
        )
    else:
        floor = surface_rows(Kind.PLAIN, 1, colour=linear("#77746c"), parameters=(0.3,))
        top = surface_rows(Kind.PLAIN, 1, colour=colour, parameters=(0.0,))
    meshes += [
        _level(door.box, 0.0, floor, up=True, fills=here),
        _level(door.box, door.height, top, up=False, fills=here),
    ]
    return Mesh.join(meshes)


def _niche(room: Room, window: Window, pale: Float[ndarray, "3"], fills: Point) -> Mesh:
    """The four sides of a window niche, and the glass at its end."""
    frame = wall_frame(room, window.side, 0.0, fills)
    a, b, low, high = window.start, window.end, SILL_M, HEAD_M

    def corner(s: float, deep: float, z: float) -> Point:
        return (*frame.at(s, -deep), z)

    d = NICHE_M
    sides = np.array([
        [corner(a, 0, low), corner(b, 0, low), corner(b, d, low), corner(a, d, low)][::-1],
        [corner(a, 0, high), corner(b, 0, high), corner(b, d, high), corner(a, d, high)],
        [corner(a, 0, low), corner(a, d, low), corner(a, d, high), corner(a, 0, high)][::-1],
        [corner(b, 0, low), corner(b, d, low), corner(b, d, high), corner(b, 0, high)],
    ])  # fmt: skip
    cheek = surface_rows(Kind.PLAIN, 1, colour=pale, parameters=(0.0,))
    cheek[:, FILLS] = fills
    glass = surface_rows(
        Kind.WINDOW, 1, colour=FRAME, origin=corner(a, d, low), heading=frame.heading, parameters=(b - a, high - low)
    )
    pane = _upright(frame.inner(0.0, -d), [(a, b, low, high)], glass)
    return Mesh.join([instances(quads(sides).reshape(1, -1, 3, 3), cheek), pane])


def leaf_frame(plan: FloorPlan, door: Doorway, fills: Point) -> tuple[Frame, bool]:
    """The frame of a leaf at its hinge, with x along the leaf, and whether the leaf lies to its left."""
    room = plan.rooms[door.rooms[0]]
    low, high = opening(room, door, door.side_of)
    # in the wall's direction, only the first two sides have the high coordinate at their end
    at_end = door.hinge_high == (door.side_of in (Side.SOUTH, Side.EAST))
    wall = wall_frame(room, door.side_of, high if at_end else low, fills)
    swing = door.angle if door.leaf == "open" else 0.0
    turn = np.pi - swing if at_end else swing
    return wall.inner(0.0, -0.03 if door.leaf == "closed" else 0.0, turn), at_end


def _door(
    parts: Parts, plan: FloorPlan, door: Doorway, colour: Float[ndarray, "3"], seed: float, fills: list[Point]
) -> None:
    """The frame on both faces of the wall, and the leaf."""
    if door.height > 2.6:
        return
    for number, side in ((door.rooms[0], door.side_of), (door.rooms[1], Side((door.side_of + 2) % 4))):
        room = plan.rooms[number]
        low, high = opening(room, door, side)
        frame, middle = wall_frame(room, side, (low + high) / 2, fills[number]), (high - low) / 2
        for x in (-middle - FRAME_M / 2, middle + FRAME_M / 2):
            if 0 < (low + high) / 2 + x < room.length(side):
                parts.box(frame, (x, 0.006, 0.0), (FRAME_M, 0.024, door.height + FRAME_M), FRAME, gloss=0.15)
        parts.box(frame, (0.0, 0.006, door.height), (2 * middle, 0.024, FRAME_M), FRAME, gloss=0.15)
    if door.leaf == "none":
        return
    hinge, mirrored = leaf_frame(plan, door, fills[door.rooms[0]])
    wide, tall = door.width - 0.02, door.height - 0.015
    aside = -LEAF_M / 2 if mirrored == (door.leaf == "open") else LEAF_M / 2
    if door.leaf == "closed":
        aside = LEAF_M / 2 if mirrored else -LEAF_M / 2
    parts.box(
        hinge, (0.01 + wide / 2, aside, 0.008), (wide, LEAF_M, tall), colour, kind=Kind.DOOR, second=FRAME, seed=seed,
        parameters=(wide, tall),
    )  # fmt: skip


def _hull(plan: FloorPlan) -> Mesh:
    """The outside of the building: walls, a flat roof, and an underside."""
    grey = surface_rows(Kind.PLAIN, 1, colour=linear("#c9c4b8"), parameters=(0.0,))
    grey[:, FILLS] = (0.05, 0.9, 0.0)
    low, high, faces = -0.3, CEILING_M + 0.4, []
    for polygon in shapely.get_parts(plan.local_building).tolist():
        ring = np.asarray(shapely.geometry.polygon.orient(polygon).exterior.coords)
        bottom, top = (
            np.column_stack([ring, np.full(len(ring), low)]),
            np.column_stack([ring, np.full(len(ring), high)]),
        )
        faces.append(quads(np.stack([bottom[:-1], bottom[1:], top[1:], top[:-1]], 1)).reshape(-1, 3, 3))
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)).tolist():
            corners = np.asarray(shapely.geometry.polygon.orient(triangle).exterior.coords)[:3]
            faces.append(np.column_stack([corners, np.full(3, high)])[None])
            faces.append(np.column_stack([corners[::-1], np.full(3, low)])[None])
    return instances(np.concatenate(faces)[None], grey)


__all__ = ["OUTER_WALL_M", "doors_of", "leaf_frame", "opening", "shell", "wall_frame"]
