"""A floor plan carved around real trajectories."""

import itertools
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float
from numpy import ndarray
from numpy.random import Generator
from shapely import MultiLineString, Polygon

from sextant.errors import UserError
from sextant.worlds.office_layouts import doors_to_corridors, name_rooms, split
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
    overlaps,
    with_windows,
)

#: smallest distance from a pose to a wall, and the margin kept when rooms and doors are cut, metres
CLEARANCE_M, ROOM_SPARE_M, DOOR_SPARE_M = 0.35, 0.5, 0.42
#: a longer step between two poses is a jump, not a path
JUMP_M = 0.5
#: a straight drive of this length is along a corridor; narrower corridors are widened
STRAIGHT_M, CORRIDOR_M = 5.5, 2.0
#: smallest and largest depth of rooms that nobody entered; narrower rooms are widened
DEPTHS_M, NARROWEST_M = (4.4, 6.0), 3.3
#: the largest floor that is planned, metres
LARGEST_M = 400.0


def plan_along(*trajectories: Float[ndarray, "n c"], seed: int = 0) -> FloorPlan:
    """A plan whose free space holds every pose, at least 0.35 m from any wall.

    The axes are those that the robot mostly drove along. Where it drove straight there is a corridor; where it left the
    corridor there is a room, with a door where it passed the wall; the remaining walls of the corridors are lined with
    rooms that nobody entered. A tangle without straight stretches becomes one hall. Steps of more than 0.5 m are jumps:
    nothing is cleared in between.

    Args:
        trajectories: x, y in metres, further columns are ignored; several drives share one plan.
        seed: decides what rooms are used for where nothing is known.

    Raises:
        UserError: there are no poses, one is not finite, or they span more than 400 m.

    >>> along = np.stack([np.linspace(0, 10, 51), np.zeros(51)], axis=1)  # ten metres straight on
    >>> plan = plan_along(along)
    >>> plan.rooms[0].kind.name, len(plan.rooms)
    ('CORRIDOR', 6)
    >>> plan.local_free.exterior.distance(shapely.LineString(plan.to_plan(along))) >= CLEARANCE_M
    True
    """
    points = [_checked(trajectory, k) for k, trajectory in enumerate(trajectories)]
    if not points:
        raise UserError("plan_along needs a trajectory, got none", "plan_along(load_cold(path).poses)")
    pieces = [piece for xy in points for piece in _pieces(xy)]
    heading = _direction(pieces)
    world = FloorPlan((), (), (), heading=heading)
    tracks = [world.to_plan(piece) for piece in pieces]
    rng = np.random.default_rng([seed, 37])
    rooms, doors = _carve(tracks, rng)
    plan = FloorPlan(tuple(rooms), tuple(doors), with_windows(rooms, rng), tuple(tracks), heading)
    if not _roomy(plan, tracks):  # a tangle: one hall contains it
        rooms = [Room(RoomKind.HALL, _bounds(_swept(tracks, 1.2)))]
        plan = FloorPlan(tuple(rooms), (), with_windows(rooms, rng), tuple(tracks), heading)
    return plan


def _checked(trajectory: Float[ndarray, "n c"], number: int) -> Float[ndarray, "n 2"]:
    points = np.asarray(trajectory, np.float64)
    if points.ndim != 2 or points.shape[1] < 2 or len(points) == 0:
        raise UserError(f"trajectory {number} needs rows of x, y (and heading), got shape {points.shape}")
    finite = np.isfinite(points[:, :2]).all(axis=1)
    if not finite.all():
        raise UserError(f"trajectory {number}: pose {int(np.argmin(finite))} is not finite")
    span = np.ptp(points[:, :2], axis=0).max()
    if span > LARGEST_M:
        raise UserError(
            f"trajectory {number} spans {span:.0f} m; an office is planned for up to {LARGEST_M:g} m",
            "Use a part of it, or a town: traced_streets.",
        )
    return points[:, :2]


def _pieces(points: Float[ndarray, "n 2"]) -> list[Float[ndarray, "m 2"]]:
    jumps = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0), axis=1) > JUMP_M) + 1
    return list(np.split(points, jumps))


def _direction(pieces: list[Float[ndarray, "n 2"]]) -> float:
    """Heading of the axis travelled most: the angle of ``sum |v| e^(4i psi)`` over 4, the longer of the two axes."""
    steps = np.concatenate([piece[8::8] - piece[:-8:8] for piece in pieces if len(piece) > 8] or [np.zeros((1, 2))])
    v = steps[:, 0] + 1j * steps[:, 1]
    length = np.abs(v)
    if length.sum() == 0:
        return 0.0
    base = float(np.angle(np.sum(length * (v / np.maximum(length, 1e-9)) ** 4)) / 4)
    turned = v * np.exp(-1j * base)
    return base if np.abs(turned.real).sum() >= np.abs(turned.imag).sum() else base + np.pi / 2


def _swept(tracks: list[Float[ndarray, "n 2"]], metres: float) -> Polygon:
    """The area closer than ``metres`` to a path."""
    lines = MultiLineString([np.vstack([track, track[-1:]]) for track in tracks])
    return shapely.buffer(shapely.simplify(lines, 0.01), metres + 0.01, quad_segs=6)


def _bounds(shape: Polygon) -> Box:
    left, bottom, right, top = (float(x) for x in shape.bounds)
    return left, bottom, right, top


# -- corridors ---------------------------------------------------------------------------------------------------------


def _bends(points: Float[ndarray, "n 2"], tolerance: float) -> list[int]:
    """Indices of the corners kept by the Douglas-Peucker algorithm."""
    keep, stack = {0, len(points) - 1}, [(0, len(points) - 1)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        along = points[b] - points[a]
        inner = points[a + 1 : b] - points[a]
        t = np.clip(inner @ along / max(float(along @ along), 1e-12), 0, 1)
        off = np.linalg.norm(inner - t[:, None] * along, axis=1)
        k = int(np.argmax(off))
        if off[k] > tolerance:
            keep.add(a + 1 + k)
            stack += [(a, a + 1 + k), (a + 1 + k, b)]
    return sorted(keep)


@dataclass
class _Straight:
    """A straight drive along ``axis``, and its points."""

    axis: int
    points: Float[ndarray, "n 2"]

    def box(self) -> Box:
        """The corridor around it: 96 % of its points keep ``ROOM_SPARE_M`` from its walls."""
        along, across = self.points[:, self.axis], self.points[:, 1 - self.axis]
        low, high = np.percentile(across, [2, 98])
        half = max(CORRIDOR_M, high - low + 2 * ROOM_SPARE_M) / 2
        middle = (low + high) / 2
        return _upright(self.axis, (along.min() - 0.6, middle - half, along.max() + 0.6, middle + half))


def _upright(axis: int, box: tuple[float, ...]) -> Box:
    """A box as (along, across) for a corridor along ``axis``, or back: the function is its own inverse."""
    a, b, c, d = (float(x) for x in box)
    return (a, b, c, d) if axis == 0 else (b, a, d, c)


def _corridors(tracks: list[Float[ndarray, "n 2"]]) -> list[Box]:
    straights: list[_Straight] = []
    for track in tracks:
        bends = _bends(track, 0.4)
        for a, b in itertools.pairwise(bends):
            move = np.abs(track[b] - track[a])
            axis = int(np.argmax(move))
            if move[axis] >= STRAIGHT_M and move[1 - axis] < 0.2 * move[axis]:
                straights.append(_Straight(axis, track[a : b + 1]))
    return _parted(_merged(straights))


def _merged(straights: list[_Straight]) -> list[_Straight]:
    """Drives along the same corridor merged into one, the longest first."""
    merged: list[_Straight] = []
    for straight in sorted(straights, key=lambda s: -float(np.ptp(s.points[:, s.axis]))):
        for k, other in enumerate(merged):
            if other.axis == straight.axis and _continues(other, straight):
                merged[k] = _Straight(other.axis, np.concatenate([other.points, straight.points]))
                break
        else:
            merged.append(straight)
    return merged


def _parted(straights: list[_Straight]) -> list[Box]:
    """Corridors with a wall between them."""
    found: list[tuple[int, Box]] = []
    for straight in straights:  # the longest stays whole, others end at its wall
        box = straight.box()
        for k, (axis, other) in enumerate(found):  # one that ends within the other's width is extended to its corner
            if axis != straight.axis and overlaps(box, other, WALL_M):
                a, b, c, d = _upright(axis, other)
                along = _upright(axis, box)
                longer = _upright(axis, (min(a, along[0]), b, max(c, along[2]), d))
                if not any(overlaps(longer, rest, WALL_M) for i, (_, rest) in enumerate(found) if i != k):
                    found[k] = (axis, longer)
        pieces = shapely.box(*box)
        for _, other in found:
            pieces = pieces.difference(shapely.box(*_grown(other, WALL_M)))
        found += [
            (straight.axis, _bounds(part))
            for part in shapely.get_parts(pieces).tolist()
            if min(_sides(_bounds(part))) > 1.5 and part.area > 0.999 * shapely.box(*part.bounds).area
        ]
    return [box for _, box in found]


def _continues(a: _Straight, b: _Straight) -> bool:
    along, across = a.axis, 1 - a.axis
    beside = abs(float(np.median(a.points[:, across]) - np.median(b.points[:, across])))
    apart = max(
        a.points[:, along].min() - b.points[:, along].max(), b.points[:, along].min() - a.points[:, along].max()
    )
    return beside < 1.2 and apart < 2.0


def _grown(box: Box, metres: float) -> Box:
    return box[0] - metres, box[1] - metres, box[2] + metres, box[3] + metres


def _sides(box: Box) -> tuple[float, float]:
    return box[2] - box[0], box[3] - box[1]


def _union(a: Box, b: Box) -> Box:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


# -- rooms -------------------------------------------------------------------------------------------------------------


def _carve(tracks: list[Float[ndarray, "n 2"]], rng: Generator) -> tuple[list[Room], list[Doorway]]:
    swept = _swept(tracks, ROOM_SPARE_M)
    corridors = _widened(_corridors(tracks), swept)
    entered = _entered(corridors, swept)
    corridors, entered = _lengthened(corridors, entered), list(entered)
    for k in range(len(entered)):
        entered[k] = _roomier(entered[k], corridors + entered[:k] + entered[k + 1 :], corridors)
    extra: list[Box] = []
    for corridor in corridors:
        for far in (False, True):
            extra += _lined(corridor, far, corridors, entered, extra, rng)
    rooms = [Room(RoomKind.CORRIDOR, box) for box in corridors]
    rooms += [Room(RoomKind.OFFICE if corridors else RoomKind.HALL, box) for box in entered + extra]
    rooms = name_rooms(rooms, rng)
    rooms = [
        Room(RoomKind.OFFICE, room.box) if i < len(corridors) + len(entered) and room.kind is RoomKind.STORE else room
        for i, room in enumerate(rooms)
    ]
    doors = _passages(rooms, tracks)
    joined = {i for door in doors for i in door.rooms}
    return rooms, doors + _junctions(rooms, doors) + doors_to_corridors(rooms, rng, joined)


def _widened(corridors: list[Box], swept: Polygon) -> list[Box]:
    """Corridors widened to include what was driven close to their walls."""
    for _ in range(3):
        for k in range(len(corridors)):
            box = corridors[k]
            rest = swept.difference(shapely.union_all([shapely.box(*other) for other in corridors]))
            near = shapely.box(*_grown(box, 0.55))
            touching = shapely.box(*_grown(box, 0.01))
            for part in shapely.get_parts(rest):
                if part.within(near) and part.intersects(touching):
                    wider = _union(box, _bounds(part))
                    others = [other for i, other in enumerate(corridors) if i != k]
                    if not any(overlaps(wider, other, WALL_M) for other in others):
                        corridors[k] = box = wider
    return corridors


def _entered(corridors: list[Box], swept: Polygon) -> list[Box]:
    """A box around each place where the path left the corridors; boxes that would overlap are merged.

    A box may have to swallow a corridor: the two become one room.
    """
    inner = [shapely.box(*box) for box in corridors]
    rest = swept.difference(shapely.union_all(inner)) if inner else swept
    boxes = []
    for part in shapely.get_parts(rest):
        box = _bounds(part)
        for corridor in corridors:
            box = _clipped(box, corridor)
        if min(_sides(box)) > 0.2:
            boxes.append(box)
    changed = True
    while changed:
        changed = False
        for i in range(len(boxes)):
            for j in range(i):
                if overlaps(boxes[i], boxes[j], WALL_M):
                    boxes[j] = _union(boxes[i], boxes[j])
                    del boxes[i]
                    changed = True
                    break
            if changed:
                break
            clash = next((c for c in corridors if overlaps(boxes[i], c, WALL_M)), None)
            if clash is not None:
                boxes[i] = _union(boxes[i], clash)
                corridors.remove(clash)
                changed = True
                break
    return boxes


def _clipped(box: Box, corridor: Box) -> Box:
    """``box`` pulled back from the wall of a corridor that it touches along a side."""
    x0, y0, x1, y1 = box
    grown = _grown(corridor, WALL_M)
    if not overlaps(box, grown):
        return box
    cuts = [
        (x0, y0, x1, min(y1, grown[1])),
        (x0, max(y0, grown[3]), x1, y1),
        (x0, y0, min(x1, grown[0]), y1),
        (max(x0, grown[2]), y0, x1, y1),
    ]
    best = max(cuts, key=lambda c: max(c[2] - c[0], 0) * max(c[3] - c[1], 0))
    # a large cut would lose the path: leave the box to be merged
    lost = 1 - max(best[2] - best[0], 0) * max(best[3] - best[1], 0) / ((x1 - x0) * (y1 - y0))
    return best if lost < 0.45 else box


def _lengthened(corridors: list[Box], entered: list[Box]) -> list[Box]:
    """Corridors extended a little beyond where the robot turned, where nothing is in the way."""
    for k, box in enumerate(corridors):
        axis = 0 if _sides(box)[0] >= _sides(box)[1] else 1
        a, b, c, d = _upright(axis, box)
        for longer in ((a - 1.4, b, c, d), (a, b, c + 1.4, d)):
            tried = _upright(axis, _union(longer, _upright(axis, box)))
            others = [other for i, other in enumerate(corridors) if i != k] + entered
            if not any(overlaps(tried, other, WALL_M) for other in others):
                corridors[k] = tried
    return corridors


def _roomier(box: Box, others: list[Box], corridors: list[Box]) -> Box:
    """A room enlarged to a sensible size where nothing is in the way, first away from its corridor."""
    for axis in (1, 0):
        for step in range(80):
            a, b, c, d = _upright(axis, box)
            least = (
                DEPTHS_M[0] if any(facing(box, corridor, 0.2) for corridor in corridors) and axis == 1 else NARROWEST_M
            )
            if c - a >= least:
                break
            grown = (a - 0.1, b, c, d) if step % 2 == 0 else (a, b, c + 0.1, d)
            tried = _upright(axis, grown)
            if not any(overlaps(tried, other, WALL_M) for other in others):
                box = tried
    return box


def _lined(
    corridor: Box, far: bool, corridors: list[Box], entered: list[Box], extra: list[Box], rng: Generator
) -> list[Box]:
    """Rooms that nobody entered along one wall of a corridor; entered ones absorb the gaps between (in place)."""
    axis = 0 if _sides(corridor)[0] >= _sides(corridor)[1] else 1
    a, b, c, d = _upright(axis, corridor)
    wall = d + WALL_M if far else b - WALL_M
    here = [k for k, box in enumerate(entered) if abs(_upright(axis, box)[1 if far else 3] - wall) < 0.05]
    deep = max([_sides(entered[k])[1 - axis] for k in here] or [0.0])
    deep = float(np.clip(deep, *DEPTHS_M))
    band = (a, wall, c, wall + deep) if far else (a, wall - deep, c, wall)
    taken = sorted(
        (_upright(axis, box)[0] - WALL_M, _upright(axis, box)[2] + WALL_M, box)
        for box in corridors + entered + extra
        if box != corridor and overlaps(_upright(axis, band), box, WALL_M)
    )
    gaps, at = [], a
    for low, high, _ in taken:
        if low > at + 0.3:
            gaps.append((at, low))
        at = max(at, high)
    if c > at + 0.3:
        gaps.append((at, c))
    found = []
    for low, high in gaps:
        if high - low >= 2.6:
            found += [_upright(axis, (s, band[1], e, band[3])) for s, e in split(low, high, rng)]
            continue
        for k in here:  # too narrow for a room: its neighbour is enlarged
            box = _upright(axis, entered[k])
            wider = _upright(axis, (min(box[0], low), box[1], max(box[2], high), box[3]))
            if (abs(box[2] + WALL_M - low) < 0.05 or abs(box[0] - WALL_M - high) < 0.05) and not any(
                overlaps(wider, other, WALL_M) for other in corridors + entered[:k] + entered[k + 1 :] + extra
            ):
                entered[k] = wider
                break
    return found


# -- doors -------------------------------------------------------------------------------------------------------------


def _passages(rooms: list[Room], tracks: list[Float[ndarray, "n 2"]]) -> list[Doorway]:
    """Openings where the path passes through walls; two that would touch become one."""
    swept = _swept(tracks, DOOR_SPARE_M)
    rest = swept.difference(shapely.union_all([shapely.box(*room.box) for room in rooms]))
    spans: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for i in range(len(rooms)):
        for j in range(i):
            common = facing(rooms[i].box, rooms[j].box, WALL_M + 0.01)
            if common is None:
                continue
            strip, vertical = _strip(rooms[i].box, rooms[j].box, common)
            for part in shapely.get_parts(rest.intersection(shapely.box(*strip))):
                box = _bounds(part) if part.area > 1e-6 else None
                if box is not None:
                    low, high = (box[1], box[3]) if vertical else (box[0], box[2])
                    crossing = max(_sides(box)) > 0.3 and min(_sides(box)) > 0.5 * WALL_M
                    if crossing:
                        spans.setdefault((i, j), []).append(_door_span(low, high, common))
    return [door for (i, j), pieces in spans.items() for door in _openings(rooms, i, j, pieces)]


def _openings(rooms: list[Room], i: int, j: int, spans: list[tuple[float, float]]) -> list[Doorway]:
    """Doors where two rooms are connected; two corridors are open to each other."""
    if rooms[i].kind is rooms[j].kind is RoomKind.CORRIDOR:
        low, high = facing(rooms[i].box, rooms[j].box, WALL_M + 0.01) or spans[0]
        return [doorway(rooms, i, j, low, high, height=CEILING_M)]
    merged: list[tuple[float, float]] = []
    for low, high in sorted(spans):
        if merged and low < merged[-1][1] + 0.5:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    return [doorway(rooms, i, j, a, b, leaf="open" if b - a < 1.1 else "none") for a, b in merged]


def _door_span(low: float, high: float, common: tuple[float, float]) -> tuple[float, float]:
    spare = max(0.9 - (high - low), 0.0) / 2
    return max(low - spare, common[0]), min(high + spare, common[1])


def _strip(a: Box, b: Box, common: tuple[float, float]) -> tuple[Box, bool]:
    """The wall between two boxes, and whether it runs along y."""
    if a[2] <= b[0] or b[2] <= a[0]:
        return (min(a[2], b[2]), common[0], max(a[0], b[0]), common[1]), True
    return (common[0], min(a[3], b[3]), common[1], max(a[1], b[1])), False


def _junctions(rooms: list[Room], doors: list[Doorway]) -> list[Doorway]:
    """Corridors that meet are open to each other."""
    found, joined = [], {frozenset(door.rooms) for door in doors}
    for i, room in enumerate(rooms):
        for j in range(i):
            if room.kind is rooms[j].kind is RoomKind.CORRIDOR and frozenset((i, j)) not in joined:
                common = facing(room.box, rooms[j].box, WALL_M + 0.01)
                if common and common[1] - common[0] > 1.0:
                    found.append(doorway(rooms, i, j, *common, height=CEILING_M))
    return found


def _roomy(plan: FloorPlan, tracks: list[Float[ndarray, "n 2"]]) -> bool:
    """Whether rooms are disjoint, poses keep ``CLEARANCE_M`` from every wall, and paths stay on free floor."""
    boxes = [room.box for room in plan.rooms]
    if any(overlaps(a, b, 0.9 * WALL_M) for i, a in enumerate(boxes) for b in boxes[:i]):
        return False
    free = plan.local_free
    points = shapely.points(np.concatenate(tracks))
    shapely.prepare(free)
    if not shapely.intersects(free, points).all() or not free.covers(_swept(tracks, 0.1)):
        return False
    return bool((shapely.distance(free.boundary, points) >= CLEARANCE_M).all())
