"""Where furniture stands: along the walls of each room, clear of doors, windows and given tracks."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import shapely
from jaxtyping import Float64
from numpy import ndarray
from numpy.random import Generator
from shapely import MultiLineString

from sextant.worlds import office_furniture as things
from sextant.worlds.office_parts import Frame, Parts, Point
from sextant.worlds.office_plan import Box, FloorPlan, RoomKind, Side, overlaps
from sextant.worlds.office_shell import doors_of, opening, wall_frame

#: distance of furniture from the given tracks, metres
KEEP_CLEAR_M = 0.42
Draw = Callable[[Parts, Frame], None]


@dataclass
class Thing:
    """A piece of furniture.

    Attributes:
        frame: where it stands.
        draw: draws it in a frame.
        box: the floor it covers, in the frame of the plan; None if it hangs on a wall.
        shade: darkness of its shadow on the floor, 0 to 1.
        room: number of the room.
        reach: half the space that a loose thing needs around its centre; 0 if it is not loose.
    """

    frame: Frame
    draw: Draw
    box: Box | None
    shade: float
    room: int
    reach: float = 0.0


@dataclass
class Sheet:
    """A poster or pinboard: where it hangs, its size and height, and the seeds of its kind and print."""

    frame: Frame
    size: tuple[float, float]
    z: float
    seeds: tuple[float, float]


@dataclass
class Desktop:
    """A desk to be covered with small things that depend on the seed."""

    frame: Frame
    seed: int


@dataclass
class Furnishing:
    """Everything in a building before anything is moved."""

    things: list[Thing] = field(default_factory=list)
    sheets: list[Sheet] = field(default_factory=list)
    desktops: list[Desktop] = field(default_factory=list)


class Furnisher:
    """Furnishes a plan, room by room.

    Args:
        plan: the floor to furnish.
        seed: decides which furniture.
        fills: light of each room.
    """

    def __init__(self, plan: FloorPlan, seed: int, fills: list[Point]):
        self.plan, self.fills, self.seed = plan, fills, seed
        self.found = Furnishing()
        lines = [np.vstack([track, track[-1:]]) for track in plan.tracks]
        self._tracks = (
            shapely.buffer(shapely.simplify(MultiLineString(lines), 0.01), KEEP_CLEAR_M, quad_segs=4) if lines else None
        )
        if self._tracks is not None:
            shapely.prepare(self._tracks)
        self._taken: list[Box] = []
        self._walls: dict[Side, list[tuple[float, float]]] = {}
        self.rng = np.random.default_rng([seed, 67])
        self.wood = things.WOODS[int(self.rng.integers(len(things.WOODS)))]
        self.fabric = things.FABRICS[int(self.rng.integers(len(things.FABRICS)))]

    def furnish(self) -> Furnishing:
        """Furnish all rooms."""
        for number, room in enumerate(self.plan.rooms):
            self.rng = np.random.default_rng([self.seed, 68, number])
            self._enter(number)
            if room.kind is not RoomKind.CORRIDOR:
                self._radiators(number)
            {
                RoomKind.CORRIDOR: self._corridor,
                RoomKind.HALL: self._hall,
                RoomKind.OFFICE: self._office,
                RoomKind.LAB: self._lab,
                RoomKind.KITCHEN: self._kitchen,
                RoomKind.MEETING: self._meeting,
                RoomKind.STORE: self._store,
            }[room.kind](number)
            if room.kind is not RoomKind.CORRIDOR:
                for _ in range(int(self.rng.integers(1, 4))):
                    self._hang(number)
        return self.found

    # -- where there is space ------------------------------------------------------------------------------------------

    def _enter(self, number: int) -> None:
        """Mark what must stay clear in a room: the space in front of doors and where their leaves turn."""
        room = self.plan.rooms[number]
        self._taken, self._walls = [], {side: [] for side in Side}
        for door, side in doors_of(self.plan, number):
            low, high = opening(room, door, side)
            deep = 1.15 if number == door.rooms[0] else (0.9 if room.kind is not RoomKind.CORRIDOR else 0.7)
            frame = wall_frame(room, side, 0.0, self.fills[number])
            reach = 0.12
            if door.leaf == "open" and number == door.rooms[0]:
                reach = 0.2
            self._taken.append(_box(frame, low - reach, high + reach, -0.1, deep))
            self._walls[side].append((low - 0.15, high + 0.15))

    def _windows(self, number: int, side: Side) -> list[tuple[float, float]]:
        return [(w.start, w.end) for w in self.plan.windows if w.room == number and w.side == side]

    def _free(self, number: int, box: Box, margin: float = 0.03) -> bool:
        x0, y0, x1, y1 = self.plan.rooms[number].box
        if box[0] < x0 - 1e-6 or box[1] < y0 - 1e-6 or box[2] > x1 + 1e-6 or box[3] > y1 + 1e-6:
            return False
        if any(overlaps(box, other, margin) for other in self._taken):
            return False
        return self._tracks is None or not shapely.intersects(self._tracks, shapely.box(*box))

    def _against_wall(
        self,
        number: int,
        size: tuple[float, float, float],
        draw: Draw,
        *,
        sides: list[Side] | None = None,
        shade: float = 0.9,
        front: float = 0.0,
        corner_first: bool = False,
    ) -> Frame | None:
        """Put a thing (width, depth, height) against a wall where it fits, with ``front`` metres clear."""
        room = self.plan.rooms[number]
        width, depth, height = size
        tries = []
        for side in sides or [Side(int(k)) for k in self.rng.permutation(4)]:
            length = room.length(side)
            if length < width + 0.1:
                continue
            offsets = np.arange(width / 2 + 0.06, length - width / 2 - 0.05, 0.17)
            order = self.rng.permutation(len(offsets))
            if corner_first:
                order = np.argsort(np.minimum(offsets, length - offsets), kind="stable")
            tries += [(side, float(offsets[k])) for k in order]
        for side, s in tries:
            if height > 0.95 and any(a < s + width / 2 and s - width / 2 < b for a, b in self._windows(number, side)):
                continue
            frame = wall_frame(room, side, s, self.fills[number])
            if self._free(number, _box(frame, -width / 2, width / 2, 0.0, depth + front)):
                box = _box(frame, -width / 2, width / 2, 0.0, depth)
                self._put(Thing(frame, draw, box, shade, number))
                if height > 0.95:
                    self._walls[side].append((s - width / 2, s + width / 2))
                return frame
        return None

    def _put(self, thing: Thing) -> None:
        self.found.things.append(thing)
        if thing.box is not None:
            self._taken.append(thing.box)

    def _stand(
        self, number: int, frame: Frame, size: tuple[float, float], draw: Draw, *, shade: float, loose: bool = False
    ) -> bool:
        """Put a thing with its centre at the origin of ``frame``, if there is room."""
        wide = max(size) if loose else 0.0
        box = _box(frame, -size[0] / 2, size[0] / 2, -size[1] / 2, size[1] / 2)
        if not self._free(number, box, 0.0):
            return False
        self._put(Thing(frame, draw, box, shade, number, reach=wide / 2))
        return True

    def _hang(self, number: int, *, size: tuple[float, float] | None = None, side: Side | None = None) -> None:
        """Hang a poster or a pinboard where a wall is bare."""
        room = self.plan.rooms[number]
        for _ in range(12):
            where = Side(int(self.rng.integers(4))) if side is None else side
            kind, print_seed = float(self.rng.random()), float(self.rng.random())
            wide, high = size or (
                (1.2, 0.9) if kind > 0.7 else ((0.6, 0.84), (0.84, 0.6), (0.42, 0.6))[int(self.rng.integers(3))]
            )
            if room.length(where) < wide + 0.5:
                continue
            s = float(self.rng.uniform(wide / 2 + 0.2, room.length(where) - wide / 2 - 0.2))
            blocked = self._walls[where] + self._windows(number, where)
            if all(s + wide / 2 + 0.08 < a or b < s - wide / 2 - 0.08 for a, b in blocked):
                self._walls[where].append((s - wide / 2, s + wide / 2))
                frame = wall_frame(room, where, s, self.fills[number])
                self.found.sheets.append(Sheet(frame, (wide, high), 1.72 - high / 2, (kind, print_seed)))
                return

    # -- rooms ---------------------------------------------------------------------------------------------------------

    def _radiators(self, number: int) -> None:
        room = self.plan.rooms[number]
        for window in self.plan.windows:
            if window.room == number:
                wide = 0.8 * (window.end - window.start)
                frame = wall_frame(room, window.side, (window.start + window.end) / 2, self.fills[number])
                box = _box(frame, -wide / 2, wide / 2, 0.0, 0.1)
                if self._free(number, box):
                    self.found.things.append(Thing(frame, partial(things.radiator, width=wide), box, 0.5, number))

    def _workplace(self, number: int) -> None:
        """A desk with a screen, small things and a chair."""
        rng, wood, fabric = self.rng, self.wood, self.fabric
        width = float(rng.choice([1.4, 1.6, 1.6]))
        seed, on, two = float(rng.random()), bool(rng.random() < 0.75), bool(rng.random() < 0.3)
        clutter_seed = int(rng.integers(1 << 30))

        def draw(parts: Parts, frame: Frame) -> None:
            things.desk(parts, frame, width, wood)
            for k, x in enumerate((-0.3, 0.3) if two else (0.05,)):
                things.monitor(
                    parts, frame.inner(x, 0.24, 0.12 - 0.24 * k if two else 0.0), 0.738, (seed + 0.37 * k) % 1, on=on
                )

        frame = self._against_wall(number, (width, 0.85, 0.75), draw, shade=0.75, front=0.35)
        if frame is None:
            return
        self.found.desktops.append(Desktop(frame, clutter_seed))
        seat = frame.inner(
            float(rng.uniform(-0.25, 0.15)), 1.02 + float(rng.uniform(0, 0.15)), float(rng.normal(0, 0.35))
        )
        self._stand(number, seat, (0.55, 0.5), partial(things.office_chair, colour=fabric), shade=0.5, loose=True)

    def _shelves(self, number: int, count: int) -> None:
        for _ in range(count):
            width, height, seed = (
                float(self.rng.choice([0.8, 1.0, 1.2])),
                float(self.rng.choice([1.5, 1.9, 2.1])),
                float(self.rng.random()),
            )
            wood = self.wood
            if self.rng.random() < 0.65:
                self._against_wall(
                    number, (width, 0.36, height),
                    partial(things.shelf, width=width, height=height, colour=wood, seed=seed),
                    front=0.3, corner_first=True,
                )  # fmt: skip
            else:
                self._against_wall(
                    number, (width, 0.46, height), partial(things.cupboard, width=width, height=height, colour=wood),
                    front=0.3, corner_first=True,
                )  # fmt: skip

    def _small(self, number: int) -> None:
        """Add a plant, a basket and a spare chair."""
        rng, fabric = self.rng, self.fabric
        if rng.random() < 0.6:
            seed = float(rng.random())
            self._against_wall(
                number,
                (0.6, 0.6, 0.9),
                _at(0.3, partial(things.plant, seed=seed)),
                shade=0.55,
                corner_first=True,
            )
        if rng.random() < 0.7:
            self._against_wall(number, (0.32, 0.34, 0.4), _at(0.18, things.bin_), shade=0.8)
        if rng.random() < 0.5:
            self._against_wall(
                number,
                (0.5, 0.5, 0.9),
                _at(0.26, partial(things.chair, colour=fabric), np.pi),
                shade=0.4,
            )

    def _office(self, number: int) -> None:
        room = self.plan.rooms[number]
        for _ in range(max(1, round(room.area_m2 / 9.0))):
            self._workplace(number)
        self._shelves(number, int(self.rng.integers(1, 4)))
        self._small(number)

    def _lab(self, number: int) -> None:
        room, rng = self.plan.rooms[number], self.rng
        for k in range(3):
            width = float(rng.choice([2.0, 2.6, 3.2]))
            seed = int(rng.integers(1 << 30))
            if width < max(room.width, room.depth) - 0.5:
                self._against_wall(
                    number, (width, 0.8, 0.9 if k == 0 else 1.5),
                    partial(things.bench, width=width, seed=seed), front=0.5, corner_first=True,
                )  # fmt: skip
        self._island(number, float(rng.uniform(1.6, 2.4)), 0.9, seats=2)
        for _ in range(2):
            self._workplace(number)
        self._shelves(number, 2)
        self._small(number)

    def _island(self, number: int, width: float, depth: float, seats: int) -> None:
        """A free-standing table with chairs around it, where it fits best."""
        room, rng, wood, fabric = self.plan.rooms[number], self.rng, self.wood, self.fabric
        x0, y0, x1, y1 = room.box
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        heading = 0.0 if room.width >= room.depth else np.pi / 2
        grid = np.stack(
            np.meshgrid(np.arange(x0 + 0.9, x1 - 0.8, 0.2), np.arange(y0 + 0.9, y1 - 0.8, 0.2)), -1
        ).reshape(-1, 2)
        for x, y in grid[np.argsort(np.linalg.norm(grid - middle, axis=1), kind="stable")]:
            frame = Frame(float(x), float(y), heading, self.fills[number])
            room_for = _box(frame, -width / 2 - 0.15, width / 2 + 0.15, -depth / 2 - 0.55, depth / 2 + 0.55)
            if self._free(number, room_for):
                self._stand(
                    number,
                    frame,
                    (width, depth),
                    partial(things.table, width=width, depth=depth, colour=wood),
                    shade=0.5,
                )
                for k in range(seats):
                    for way in (-1, 1):
                        seat = frame.inner(
                            (k + 0.5) * width / seats - width / 2,
                            way * (depth / 2 + 0.27),
                            (0 if way > 0 else np.pi) + float(rng.normal(0, 0.12)),
                        )
                        self._stand(
                            number, seat, (0.46, 0.46), partial(things.chair, colour=fabric), shade=0.4, loose=True
                        )
                return

    def _kitchen(self, number: int) -> None:
        room, rng, wood = self.plan.rooms[number], self.rng, self.wood
        width, seed = min(3.0, max(room.width, room.depth) - 0.9), int(self.rng.integers(1 << 30))
        self._against_wall(
            number,
            (width, 0.64, 2.1),
            partial(things.kitchen_row, width=width, colour=wood, seed=seed),
            front=0.7,
            corner_first=True,
        )
        self._against_wall(number, (0.64, 0.68, 1.8), things.fridge, front=0.5, corner_first=True)
        self._island(number, min(1.4, 0.5 * max(room.width, room.depth)), 0.75, seats=int(rng.integers(1, 3)))
        self._small(number)

    def _meeting(self, number: int) -> None:
        room = self.plan.rooms[number]
        long = max(room.width, room.depth)
        self._island(number, min(long - 2.2, 3.2), 1.1, seats=max(1, int((min(long - 2.2, 3.2)) / 0.75)))
        self._hang(number, size=(1.6, 1.0))
        self._shelves(number, 1)
        self._small(number)

    def _hall(self, number: int) -> None:
        rng, fabric, wood = self.rng, self.fabric, self.wood
        for _ in range(3):
            width = float(rng.choice([1.5, 1.9]))
            frame = self._against_wall(
                number, (width, 0.82, 0.8), partial(things.sofa, width=width, colour=fabric), front=0.9
            )
            if frame is not None:
                self._stand(
                    number,
                    frame.inner(0.0, 1.3),
                    (0.8, 0.5),
                    partial(things.table, width=0.8, depth=0.5, colour=wood, height=0.42),
                    shade=0.6,
                )
        self._island(number, 1.2, 0.8, seats=2)
        for _ in range(3):
            self._small(number)
        self._shelves(number, 1)

    def _store(self, number: int) -> None:
        self._shelves(number, 5)

    def _corridor(self, number: int) -> None:
        """Name plates, posters, extinguishers, and a few low things where the corridor is wide enough."""
        room, rng = self.plan.rooms[number], self.rng
        for door, side in doors_of(self.plan, number):
            if door.height > 2.2 or number != door.rooms[1]:
                continue
            low, high = opening(room, door, side)
            s = high + 0.24 if high + 0.4 < room.length(side) else low - 0.24
            frame, seed = wall_frame(room, side, s, self.fills[number]), float(rng.random())
            self._walls[side].append((s - 0.12, s + 0.12))
            self.found.things.append(Thing(frame, partial(things.name_plate, seed=seed), None, 0.0, number))
        long = max(room.width, room.depth)
        sides = [side for side in Side if room.length(side) > 3]
        for _ in range(max(1, round(long / 14))):
            side = sides[int(rng.integers(len(sides)))] if sides else Side.SOUTH
            self._mount(number, side, things.extinguisher)
        for _ in range(round(long / 4.0)):
            if sides:
                self._hang(number, side=sides[int(rng.integers(len(sides)))])
        if min(room.width, room.depth) > 1.7:
            for _ in range(round(long / 6.0)):
                what, seed = rng.random(), float(rng.random())
                if what < 0.4:
                    self._against_wall(
                        number,
                        (1.0, 0.4, 1.2),
                        partial(things.cupboard, width=1.0, height=1.1, colour=self.wood, depth=0.36),
                        sides=sides or None,
                    )
                elif what < 0.65:
                    self._against_wall(
                        number,
                        (0.56, 0.5, 0.9),
                        _at(0.26, partial(things.plant, seed=seed)),
                        sides=sides or None,
                        shade=0.55,
                    )
                elif what < 0.8:
                    self._against_wall(number, (0.7, 0.7, 1.1), things.copier, sides=sides or None)
                else:
                    fabric = self.fabric
                    self._against_wall(
                        number,
                        (0.5, 0.5, 0.9),
                        _at(0.26, partial(things.chair, colour=fabric), np.pi),
                        sides=sides or None,
                        shade=0.4,
                    )

    def _mount(self, number: int, side: Side, draw: Draw) -> None:
        """Hang a thing on a bare stretch of wall, away from the tracks."""
        room = self.plan.rooms[number]
        for _ in range(20):
            s = float(self.rng.uniform(0.4, max(room.length(side) - 0.4, 0.5)))
            frame = wall_frame(room, side, s, self.fills[number])
            box = _box(frame, -0.15, 0.15, 0.0, 0.2)
            bare = all(s + 0.2 < a or b < s - 0.2 for a, b in self._walls[side] + self._windows(number, side))
            if bare and self._free(number, box, 0.0):
                self._walls[side].append((s - 0.2, s + 0.2))
                self._put(Thing(frame, draw, box, 0.15, number))
                return


def shifted(
    thing: Thing, things_there: list[Box], plan: FloorPlan, tracks: shapely.Geometry | None, rng: Generator
) -> Thing:
    """A loose thing, moved by up to 0.7 m and turned to where there is room; unchanged if there is none."""
    for _ in range(10):
        moved = thing.frame.inner(
            float(rng.uniform(-0.7, 0.7)), float(rng.uniform(-0.7, 0.7)), float(rng.uniform(-np.pi, np.pi))
        )
        reach = thing.reach + 0.06
        box = (moved.x - reach, moved.y - reach, moved.x + reach, moved.y + reach)
        x0, y0, x1, y1 = plan.rooms[thing.room].box
        inside = x0 <= box[0] and y0 <= box[1] and box[2] <= x1 and box[3] <= y1
        clear = inside and not any(overlaps(box, other) for other in things_there)
        if clear and (tracks is None or not shapely.intersects(tracks, shapely.box(*box))):
            return Thing(moved, thing.draw, box, thing.shade, thing.room, thing.reach)
    return thing


def keep_clear(plan: FloorPlan) -> shapely.Geometry | None:
    """The area that furniture stays clear of, in the frame of the plan."""
    if not plan.tracks:
        return None
    lines = MultiLineString([np.vstack([track, track[-1:]]) for track in plan.tracks])
    return shapely.buffer(shapely.simplify(lines, 0.01), KEEP_CLEAR_M, quad_segs=4)


def _at(y: float, draw: Draw, turn: float = 0.0) -> Draw:
    """Draw something centred at its origin ``y`` metres from the wall, turned."""

    def drawn(parts: Parts, frame: Frame) -> None:
        draw(parts, frame.inner(0.0, y, turn))

    return drawn


def _box(frame: Frame, x0: float, x1: float, y0: float, y1: float) -> Box:
    """The smallest axis-aligned box of the plan around a rectangle in a frame."""
    corners: Float64[ndarray, "4 2"] = np.array([frame.at(x, y) for x in (x0, x1) for y in (y0, y1)])
    low, high = corners.min(0), corners.max(0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


__all__ = ["KEEP_CLEAR_M", "Desktop", "Furnisher", "Furnishing", "Sheet", "Thing", "keep_clear", "shifted"]
