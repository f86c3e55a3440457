"""Floor plans from a seed: rooms of equal width on both sides of corridors."""

import numpy as np
from numpy.random import Generator

from sextant.errors import ArgumentError
from sextant.worlds.office_plan import (
    CEILING_M,
    WALL_M,
    Box,
    Doorway,
    FloorPlan,
    Room,
    RoomKind,
    doorway,
    facing,
    with_windows,
)

#: smallest and largest width and depth of a building, metres
SIZES_M = ((12.0, 200.0), (9.0, 120.0))
CORRIDOR_M, MODULE_M, DEPTH_M = 1.9, 3.6, 4.8


def procedural_plan(size_m: tuple[float, float], seed: int) -> FloorPlan:
    """A building that measures ``size_m`` metres between its outer walls; the same seed gives the same plan.

    Corridors run along x, as many as make rooms about 4.8 m deep, and are linked by cross corridors. Rooms have equal
    widths, so that corridors look alike; among the offices there are a kitchen, a hall, laboratories, meeting rooms and
    stores. Most doors are open; those of stores are closed.

    Raises:
        ArgumentError: a side is not a number within ``SIZES_M``.

    >>> plan = procedural_plan((40.0, 16.0), seed=0)
    >>> len(plan.rooms), plan.rooms[0].kind.name
    (18, 'CORRIDOR')
    """
    for side, value, (low, high) in zip(("width", "depth"), size_m, SIZES_M, strict=True):
        if not (isinstance(value, int | float) and np.isfinite(value) and low <= value <= high):
            raise ArgumentError(
                f"size_m={list(size_m)}: the {side} must be a number of metres from {low:g} to {high:g}",
                "For example size_m=[40,16]",
            )
    rng = np.random.default_rng([seed, 31])
    width, height = map(float, size_m)
    levels, depth = _rows(height)
    pitch = 2 * depth + CORRIDOR_M + 3 * WALL_M
    corridors = [
        (0.0, k * pitch + depth + WALL_M, width, k * pitch + depth + WALL_M + CORRIDOR_M) for k in range(levels)
    ]
    crossings = _crossings(width, levels)
    rooms = [Room(RoomKind.CORRIDOR, box) for box in corridors]
    doors: list[Doorway] = []
    for k in range(levels - 1):
        for x in crossings:
            box = (x - CORRIDOR_M / 2, corridors[k][3] + WALL_M, x + CORRIDOR_M / 2, corridors[k + 1][1] - WALL_M)
            rooms.append(Room(RoomKind.CORRIDOR, box))
            doors += [doorway(rooms, len(rooms) - 1, end, box[0], box[2], height=CEILING_M) for end in (k, k + 1)]
    for k in range(levels):
        for y0, inner in ((k * pitch, k > 0), (corridors[k][3] + WALL_M, k < levels - 1)):
            cuts = [(x - CORRIDOR_M / 2 - WALL_M, x + CORRIDOR_M / 2 + WALL_M) for x in crossings] if inner else []
            for low, high in _between(0.0, width, cuts):
                rooms += [Room(RoomKind.OFFICE, (a, y0, b, y0 + depth)) for a, b in split(low, high, rng)]
    rooms = name_rooms(rooms, rng)
    doors += doors_to_corridors(rooms, rng)
    return FloorPlan(tuple(rooms), tuple(doors), with_windows(rooms, rng))


def _rows(height: float) -> tuple[int, float]:
    """How many corridors fit, and the resulting depth of the rooms."""
    best = (1, (height - CORRIDOR_M - 2 * WALL_M) / 2)
    for levels in range(2, 20):
        depth = (height - levels * (CORRIDOR_M + 2 * WALL_M) - (levels - 1) * WALL_M) / (2 * levels)
        if depth >= 3.2 and abs(depth - DEPTH_M) < abs(best[1] - DEPTH_M):
            best = (levels, depth)
    return best


def _crossings(width: float, levels: int) -> list[float]:
    if levels == 1:
        return []
    if width < 24:
        return [width / 2]
    return [float(x) for x in np.linspace(0.12 * width, 0.88 * width, max(2, round(width / 25)))]


def _between(low: float, high: float, cuts: list[tuple[float, float]]) -> list[tuple[float, float]]:
    edges = [low] + [x for cut in cuts for x in cut] + [high]
    return [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= 2.2]


def split(low: float, high: float, rng: Generator) -> list[tuple[float, float]]:
    """Rooms side by side from ``low`` to ``high``, made of equal modules: one room in six has two."""
    count = max(1, round((high - low + WALL_M) / (MODULE_M + WALL_M)))
    pitch = (high - low + WALL_M) / count
    found, k = [], 0
    while k < count:
        modules = 2 if k + 1 < count and rng.random() < 0.18 else 1
        found.append((low + k * pitch, low + (k + modules) * pitch - WALL_M))
        k += modules
    return found


def name_rooms(rooms: list[Room], rng: Generator) -> list[Room]:
    """Uses for the rooms that are offices so far: wide ones become laboratories, halls or meeting rooms."""
    offices = [i for i, room in enumerate(rooms) if room.kind is RoomKind.OFFICE]
    wide = 1.4 * float(np.median([rooms[i].area_m2 for i in offices])) if offices else 0.0
    narrow = [i for i in offices if rooms[i].area_m2 <= wide]
    named, wide_seen = [], 0
    kitchens = (
        set(rng.choice(narrow, min(len(narrow), 1 + len(offices) // 22), replace=False).tolist()) if narrow else set()
    )
    for i, room in enumerate(rooms):
        kind = room.kind
        if kind is RoomKind.OFFICE:
            if room.area_m2 > wide:
                kind = (RoomKind.LAB, RoomKind.HALL, RoomKind.MEETING)[wide_seen % 3]
                wide_seen += 1
            elif i in kitchens:
                kind = RoomKind.KITCHEN
            elif rng.random() < 0.1:
                kind = RoomKind.STORE if rng.random() < 0.5 else RoomKind.MEETING
        named.append(Room(kind, room.box))
    return named


def doors_to_corridors(rooms: list[Room], rng: Generator, done: set[int] | None = None) -> list[Doorway]:
    """A door from every room, except those ``done``, to the corridor with which it shares the longest wall."""
    doors: list[Doorway] = []
    corridors = [i for i, room in enumerate(rooms) if room.kind is RoomKind.CORRIDOR]
    for i, room in enumerate(rooms):
        if room.kind is RoomKind.CORRIDOR or i in (done or ()):
            continue
        common = [
            (span[1] - span[0], j, span) for j in corridors if (span := facing(room.box, rooms[j].box, WALL_M + 0.01))
        ]
        if common and max(common)[0] >= 1.2:
            _, j, (low, high) = max(common)
            doors.append(_door(rooms, i, j, low, high, rng))
    return doors


def _door(rooms: list[Room], i: int, j: int, low: float, high: float, rng: Generator) -> Doorway:
    kind, high_end = rooms[i].kind, bool(rng.random() < 0.5)
    if kind is RoomKind.HALL and high - low > 4:
        middle = (low + high) / 2
        return doorway(rooms, i, j, middle - 1.4, middle + 1.4, height=2.4)
    wide = min(1.7 if kind is RoomKind.LAB else 0.92, high - low - 0.2)
    inset = min(0.35, (high - low - wide) / 2)
    start = high - inset - wide if high_end else low + inset
    shut = kind is RoomKind.STORE or rng.random() < 0.1
    leaf = "none" if wide > 1.2 else ("closed" if shut else "open")
    return doorway(
        rooms, i, j, start, start + wide, leaf=leaf, hinge_high=high_end, angle=float(rng.uniform(1.45, 1.62))
    )


__all__ = ["SIZES_M", "Box", "procedural_plan"]
