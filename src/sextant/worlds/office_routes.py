"""Drives of a robot through an office, from place to place along shortest paths."""

from collections.abc import Callable

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.ndimage import uniform_filter1d
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from sextant.errors import UserError
from sextant.worlds.office_plan import FloorPlan

CELL_M, CLEARANCE_M, SMOOTH_M = 0.2, 0.5, 0.7
#: for drives through a mapped floor: distance beyond which a cell is off the mapping drive, and the cost of going there
BESIDE_M, DETOUR = 0.4, 6.0


def wander(plan: FloorPlan, length_m: float, step_m: float, rng: np.random.Generator) -> Float64[ndarray, "n 3"]:
    """Poses (x, y, heading) every ``step_m`` along a drive of ``length_m`` that keeps ``CLEARANCE_M`` from the walls.

    Raises:
        UserError: a length is not positive, or the plan has no room to drive in.
    """
    return _drive(plan, length_m, step_m, rng, lambda reachable, way, points: int(rng.choice(reachable)))


def survey(plan: FloorPlan, length_m: float, step_m: float, rng: np.random.Generator) -> Float64[ndarray, "n 3"]:
    """A drive to map the floor: always to the place farthest from the path so far, then all the way back.

    So every place on the path is seen in both directions.

    Raises:
        UserError: as for :func:`wander`.
    """
    out = _drive(plan, length_m / 2, step_m, rng, _farthest)
    back = out[::-1] + np.array([0.0, 0.0, np.pi])
    back[:, 2] = (back[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return np.concatenate([out, back[1:]])


def revisit(
    plan: FloorPlan,
    mapped: Float64[ndarray, "m 2"],
    length_m: float,
    step_m: float,
    rng: np.random.Generator,
) -> Float64[ndarray, "n 3"]:
    """A drive through a mapped floor, between random places of the mapping drive and preferably along it.

    A path through cells farther than ``BESIDE_M`` from the mapping drive costs ``DETOUR`` times its length.

    Raises:
        UserError: as for :func:`wander`.
    """
    tree = cKDTree(mapped)

    def near(points: Float64[ndarray, "p 2"]) -> Bool[ndarray, "p"]:
        return np.asarray(tree.query(points, distance_upper_bound=BESIDE_M)[0] <= BESIDE_M)

    def choose(reachable: Int64[ndarray, "k"], way: Float64[ndarray, "w 2"], points: Float64[ndarray, "p 2"]) -> int:
        on_the_way = reachable[near(points[reachable])]
        return int(rng.choice(on_the_way if len(on_the_way) else reachable))

    return _drive(plan, length_m, step_m, rng, choose, near)


#: chooses the next destination among the reachable points (by index), given the path so far and all points
Choose = Callable[[Int64[ndarray, "k"], Float64[ndarray, "w 2"], Float64[ndarray, "p 2"]], int]


def _farthest(reachable: Int64[ndarray, "k"], way: Float64[ndarray, "w 2"], points: Float64[ndarray, "p 2"]) -> int:
    return int(reachable[cKDTree(way).query(points[reachable])[0].argmax()])


def _drive(
    plan: FloorPlan,
    length_m: float,
    step_m: float,
    rng: np.random.Generator,
    choose: Choose,
    preferred: Callable[[Float64[ndarray, "p 2"]], Bool[ndarray, "p"]] | None = None,
) -> Float64[ndarray, "n 3"]:
    """Poses along shortest paths from one chosen place to the next."""
    for key, value in (("metres", length_m), ("step_m", step_m)):
        if not 0 < value < 1e6:
            raise UserError(
                f"office route: {key} is {value:g}; it must be above 0 and below 1e6", "Try metres=[120,60]."
            )
    room = plan.walkable.buffer(-CLEARANCE_M)
    if room.is_empty:
        raise UserError("office route: no room to drive between the walls", "Use a larger size_m.")
    room = max(shapely.get_parts(room).tolist(), key=lambda part: part.area)
    left, bottom, right, top = room.bounds
    columns, rows = int((right - left) / CELL_M) + 1, int((top - bottom) / CELL_M) + 1
    x, y = np.meshgrid(left + CELL_M * np.arange(columns), bottom + CELL_M * np.arange(rows))
    free = shapely.contains_xy(room, x, y)
    places = np.flatnonzero(free)
    points = np.column_stack([x.ravel(), y.ravel()])
    liked = np.ones(len(points), bool) if preferred is None else preferred(points)
    graph = _neighbours(free, np.where(liked, 1.0, DETOUR))
    starts = places[liked[places]]
    way: list[int] = [int(rng.choice(starts if len(starts) else places))]
    driven = 0.0
    while driven < length_m + 2 * SMOOTH_M:
        distance, before = dijkstra(graph, indices=way[-1], return_predecessors=True)
        reachable = places[np.isfinite(distance[places]) & (distance[places] > 3)]
        if not len(reachable):
            raise UserError("office route: the free floor is too small to drive in", "Use a larger size_m.")
        leg = [choose(reachable, points[way], points)]
        while leg[-1] != way[-1]:
            leg.append(int(before[leg[-1]]))
        driven += float(np.linalg.norm(np.diff(points[leg], axis=0), axis=1).sum())
        way += leg[-2::-1]
    return _poses(points[way], length_m, step_m)


def _neighbours(free: Bool[ndarray, "r c"], cost: Float64[ndarray, "n"]) -> coo_array:
    """Distances in metres between adjacent free cells, diagonal ones included, times the mean cost of the two."""
    rows, columns = free.shape
    index: Int64[ndarray, "r c"] = np.arange(rows * columns).reshape(rows, columns)
    starts, ends, metres = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, rows - down), slice(max(0, -right), columns - max(0, right)))
        there = (slice(down, rows), slice(max(0, right), columns + min(0, right)))
        both = free[here] & free[there]
        starts.append(index[here][both])
        ends.append(index[there][both])
        metres.append(CELL_M * float(np.hypot(down, right)) * (cost[starts[-1]] + cost[ends[-1]]) / 2)
    a, b, d = np.concatenate(starts), np.concatenate(ends), np.concatenate(metres)
    return coo_array((np.r_[d, d], (np.r_[a, b], np.r_[b, a])), shape=(free.size, free.size)).tocsr()


def _poses(way: Float64[ndarray, "k 2"], length_m: float, step_m: float) -> Float64[ndarray, "n 3"]:
    """A smooth drive along a path of grid cells, sampled by distance; the robot turns on the spot at sharp corners."""
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))]
    fine = np.arange(0, arc[-1], 0.02)
    line = np.column_stack([np.interp(fine, arc, way[:, k]) for k in range(2)])
    window = int(SMOOTH_M / 0.02)
    smooth = uniform_filter1d(line, window, axis=0, mode="nearest")
    ahead = np.roll(smooth, -10, axis=0) - np.roll(smooth, 10, axis=0)
    ahead[:10], ahead[-10:] = ahead[10], ahead[-11]
    heading = uniform_filter1d(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])), 25, mode="nearest")
    travelled = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1))]
    at = np.arange(0, min(length_m, travelled[-1]), step_m)
    x, y, theta = (np.interp(at, travelled, column) for column in (smooth[:, 0], smooth[:, 1], heading))
    return np.column_stack([x, y, (theta + np.pi) % (2 * np.pi) - np.pi])
