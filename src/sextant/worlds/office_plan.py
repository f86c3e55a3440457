"""Floor plans: rooms, doorways and windows as exact geometry in two dimensions.

All spaces are rectangles in the frame of the plan, whose axes are parallel to the walls; the plan as a whole may be
rotated in the world. What is neither a room nor a doorway is wall.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float
from numpy import ndarray
from shapely import Polygon

from sextant.errors import UserError

#: metres: thickness of partitions and outer walls, height of ceilings and doors
WALL_M, OUTER_WALL_M, CEILING_M, DOOR_M = 0.15, 0.35, 2.7, 2.06
#: window sills and heads above the floor, metres
SILL_M, HEAD_M = 0.92, 2.3
#: x and y of the lower left corner, then of the upper right one; metres in the frame of the plan
Box = tuple[float, float, float, float]


class RoomKind(StrEnum):
    """What a room is for; it determines floor and furniture."""

    CORRIDOR = "corridor"
    HALL = "hall"
    OFFICE = "office"
    LAB = "lab"
    KITCHEN = "kitchen"
    MEETING = "meeting"
    STORE = "store"


class Side(IntEnum):
    """The walls of a room, counter-clockwise: walking along a wall from its start, the room is on the left."""

    SOUTH = 0
    EAST = 1
    NORTH = 2
    WEST = 3


@dataclass(frozen=True)
class Room:
    """A room, or a stretch of corridor.

    Attributes:
        kind: what it is for.
        box: its floor.
    """

    kind: RoomKind
    box: Box

    @property
    def width(self) -> float:
        """Metres along the x axis of the plan."""
        return self.box[2] - self.box[0]

    @property
    def depth(self) -> float:
        """Metres along the y axis of the plan."""
        return self.box[3] - self.box[1]

    @property
    def area_m2(self) -> float:
        """Square metres of floor."""
        return self.width * self.depth

    def length(self, side: Side) -> float:
        """Metres of a wall."""
        return self.width if side in (Side.SOUTH, Side.NORTH) else self.depth

    def start(self, side: Side) -> tuple[float, float]:
        """Where a wall begins."""
        x0, y0, x1, y1 = self.box
        return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))[side]


@dataclass(frozen=True)
class Doorway:
    """An opening through the wall between two rooms.

    Attributes:
        box: the floor of the passage, from face to face of the wall.
        rooms: numbers of the two rooms; a leaf opens into the first.
        height: metres; ``CEILING_M`` where two stretches of corridor are joined.
        leaf: ``none``, ``open`` or ``closed``.
        hinge_high: whether the hinge is at the end with the larger coordinate.
        angle: by how much an open leaf has turned, radians.
    """

    box: Box
    rooms: tuple[int, int]
    height: float = DOOR_M
    leaf: str = "none"
    hinge_high: bool = False
    angle: float = 1.5

    @property
    def across_x(self) -> bool:
        """Whether the passage leads along the x axis."""
        return self.side_of is not None and self.side_of in (Side.EAST, Side.WEST)

    side_of: Side = Side.SOUTH  # which wall of the first room it is in

    @property
    def width(self) -> float:
        """Clear width, metres."""
        return self.box[3] - self.box[1] if self.across_x else self.box[2] - self.box[0]

    @property
    def passable(self) -> bool:
        """Whether it can be walked through."""
        return self.leaf != "closed"


@dataclass(frozen=True)
class Window:
    """A window in an outer wall.

    Attributes:
        room: number of the room.
        side: which of its walls.
        start, end: metres along that wall.
    """

    room: int
    side: Side
    start: float
    end: float


@dataclass(frozen=True)
class FloorPlan:
    """One floor of a building.

    Attributes:
        rooms, doors, windows: its elements, in the frame of the plan.
        tracks: lines that furniture stays clear of, in the frame of the plan, ``(n, 2)`` each.
        heading: direction of the plan's x axis in the world, radians.
        origin: the plan's origin in the world, metres.
    """

    rooms: tuple[Room, ...]
    doors: tuple[Doorway, ...]
    windows: tuple[Window, ...]
    tracks: tuple[Float[ndarray, "n 2"], ...] = field(default=(), repr=False)
    heading: float = 0.0
    origin: tuple[float, float] = (0.0, 0.0)

    def to_world(self, points: Float[ndarray, "*n 2"]) -> Float[ndarray, "*n 2"]:
        """Points in the world, metres, from points in the frame of the plan."""
        return np.asarray(points @ _turn(self.heading).T + self.origin)

    def to_plan(self, points: Float[ndarray, "*n 2"]) -> Float[ndarray, "*n 2"]:
        """Points in the frame of the plan from points in the world, metres."""
        return np.asarray((points - self.origin) @ _turn(self.heading))

    @cached_property
    def local_free(self) -> Polygon:
        """Free floor in the frame of the plan: rooms, and doorways that are not closed."""
        boxes = [room.box for room in self.rooms] + [door.box for door in self.doors if door.passable]
        return shapely.union_all([shapely.box(*box) for box in boxes])

    @cached_property
    def free(self) -> Polygon:
        """Free floor in the world; several polygons where closed doors divide it."""
        return self._placed(self.local_free)

    @cached_property
    def walkable(self) -> Polygon:
        """The largest connected part of ``free``, which a robot can reach, in the world."""
        parts = shapely.get_parts(self.free)
        return parts[int(np.argmax(shapely.area(parts)))]

    @cached_property
    def building(self) -> Polygon:
        """Everything within the outer walls, in the world."""
        return self._placed(self.local_building)

    @cached_property
    def local_building(self) -> Polygon:
        """Everything within the outer walls, in the frame of the plan, without courtyards."""
        reach = OUTER_WALL_M
        grown = shapely.union_all([shapely.box(b[0] - reach, b[1] - reach, b[2] + reach, b[3] + reach)
                                   for b in (room.box for room in self.rooms)])  # fmt: skip
        return shapely.union_all([Polygon(part.exterior) for part in shapely.get_parts(grown)])

    @cached_property
    def walls(self) -> Polygon:
        """Solid walls in the world, with their thickness; closed doors count as walls."""
        return self.building.difference(self.free)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x and y, largest x and y of the building in the world, metres."""
        left, bottom, right, top = self.building.bounds
        return float(left), float(bottom), float(right), float(top)

    @property
    def floor_area_m2(self) -> float:
        """Square metres of all rooms."""
        return sum(room.area_m2 for room in self.rooms)

    def check_poses(self, poses: Float[ndarray, "n c"], clearance_m: float = 0.0) -> None:
        """Check that poses stand on free floor.

        Args:
            poses: x, y in metres in the world; further columns are ignored.
            clearance_m: smallest allowed distance to a wall.

        Raises:
            UserError: a pose is not finite, in a wall, outside the building, or closer to a wall than allowed; names
                the index and position of the first.
        """
        points = np.asarray(poses, np.float64)
        if points.ndim != 2 or points.shape[1] < 2:
            raise UserError(f"poses need rows of x, y (and heading), got shape {points.shape}")
        finite = np.isfinite(points[:, :2]).all(axis=1)
        if not finite.all():
            raise UserError(f"pose {int(np.argmin(finite))} is not finite: {points[np.argmin(finite)].tolist()}")
        dots = shapely.points(points[:, :2])
        shapely.prepare(self.free)
        good = shapely.intersects(self.free, dots)
        if clearance_m > 0:
            good &= shapely.distance(self.free.boundary, dots) >= clearance_m
        if good.all():
            return
        i = int(np.argmin(good))
        x, y = points[i, :2]
        if not self.building.intersects(dots[i]):
            where = "outside the building"
        elif not self.free.intersects(dots[i]):
            where = "inside a wall"
        else:
            where = f"{shapely.distance(self.free.boundary, dots[i]):.3f} m from a wall"
        left, bottom, right, top = self.bounds
        raise UserError(
            f"pose {i} at ({x:.3f}, {y:.3f}) m is {where}; {int((~good).sum())} of {len(good)} poses are not on free "
            f"floor" + (f" with {clearance_m:g} m to spare" if clearance_m > 0 else ""),
            f"The building spans x {left:.1f} to {right:.1f} m and y {bottom:.1f} to {top:.1f} m. Use poses within its "
            f"free space, or a plan that is carved around them: plan_along(poses).",
        )

    def moved(self, heading: float, origin: tuple[float, float]) -> "FloorPlan":
        """The same plan elsewhere in the world."""
        return replace(self, heading=heading, origin=origin)

    def _placed(self, shape: Polygon) -> Polygon:
        return shapely.transform(shape, self.to_world)


def _turn(heading: float) -> Float[ndarray, "2 2"]:
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s], [s, c]])


def doorway(rooms: list[Room], first: int, second: int, low: float, high: float, **how: object) -> Doorway:
    """An opening from ``low`` to ``high`` (coordinates along the wall) through the wall between two rooms.

    Raises:
        ValueError: the rooms do not face each other.
    """
    a, b = rooms[first].box, rooms[second].box
    for side, (near, far, vertical) in enumerate(
        [(b[3], a[1], False), (a[2], b[0], True), (a[3], b[1], False), (b[2], a[0], True)]
    ):
        lap = (max(a[1], b[1]), min(a[3], b[3])) if vertical else (max(a[0], b[0]), min(a[2], b[2]))
        if near <= far and lap[0] < lap[1]:
            box = (near, low, far, high) if vertical else (low, near, high, far)
            return Doorway(box, (first, second), side_of=Side(side), **how)  # type: ignore[arg-type]
    raise ValueError(f"rooms {first} and {second} do not face each other: {a}, {b}")


def facing(a: Box, b: Box, gap: float) -> tuple[float, float] | None:
    """The stretch along which two boxes face each other across at most ``gap`` metres; None where they do not."""
    dx, dy = max(b[0] - a[2], a[0] - b[2]), max(b[1] - a[3], a[1] - b[3])
    if 0 <= dx <= gap and dy < 0:
        return max(a[1], b[1]), min(a[3], b[3])
    if 0 <= dy <= gap and dx < 0:
        return max(a[0], b[0]), min(a[2], b[2])
    return None


def overlaps(a: Box, b: Box, margin: float = 0.0) -> bool:
    """Whether two boxes come closer than ``margin`` metres."""
    slack = margin - 1e-9
    return a[0] < b[2] + slack and b[0] < a[2] + slack and a[1] < b[3] + slack and b[1] < a[3] + slack


def with_windows(rooms: list[Room], rng: np.random.Generator, share: float = 0.9) -> tuple[Window, ...]:
    """Windows in every wall to the open air, for a ``share`` of the rooms."""
    windows = []
    for number, room in enumerate(rooms):
        if room.kind is RoomKind.STORE or rng.random() > share:
            continue
        for side in Side:
            wide = 1.2 if room.kind is RoomKind.CORRIDOR else float(rng.choice([1.3, 1.6, 1.9]))
            if room.kind is RoomKind.CORRIDOR and room.length(side) > 5:
                wide = 1.6
            for low, high in _open_air(rooms, number, side):
                room_for = high - low - 0.5
                count = int(room_for // (wide + 0.7)) if room_for > wide + 0.8 else int(room_for >= wide)
                pitch = (high - low) / max(count, 1)
                windows += [
                    Window(number, side, low + (k + 0.5) * pitch - wide / 2, low + (k + 0.5) * pitch + wide / 2)
                    for k in range(count)
                ]
    return tuple(windows)


def _open_air(rooms: list[Room], number: int, side: Side) -> list[tuple[float, float]]:
    """Stretches of a wall (metres from its start) with no room behind it."""
    room, reach = rooms[number], 2 * OUTER_WALL_M
    x0, y0, x1, y1 = room.box
    strip = ((x0, y0 - reach, x1, y0), (x1, y0, x1 + reach, y1), (x0, y1, x1, y1 + reach), (x0 - reach, y0, x0, y1))[
        side
    ]
    level = side in (Side.SOUTH, Side.NORTH)
    low, high = (strip[0], strip[2]) if level else (strip[1], strip[3])
    taken = sorted(
        (other.box[0 if level else 1] - 0.2, other.box[2 if level else 3] + 0.2)
        for k, other in enumerate(rooms)
        if k != number and overlaps(strip, other.box)
    )
    stretches, at = [], low
    for a, b in taken:
        if a > at:
            stretches.append((at, a))
        at = max(at, b)
    if at < high:
        stretches.append((at, high))
    if side in (Side.SOUTH, Side.EAST):
        return [(a - low, b - low) for a, b in stretches]
    return [(high - b, high - a) for a, b in stretches]
