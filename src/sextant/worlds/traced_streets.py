"""A street graph from a real trajectory."""

from itertools import pairwise

import networkx as nx
import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from sextant.errors import UserError
from sextant.worlds.side_streets import add_side_streets
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import AVENUE_WIDTH_M, STREET_WIDTH_M, check_range
from sextant.worlds.street_repair import join, prune, repair, straighten

#: Passes closer than this to an existing street follow it: no house would fit between them.
MERGE_M = 25.0


def traced_streets(
    positions: Float[ndarray, "n 2"], *, seed: int = 0, side_streets: float = 0.5, reach_m: float = 220.0
) -> StreetGraph:
    """Streets along a trajectory: one centre line for all passes through a street, junctions where it meets itself.

    1. Anchors are placed along the trajectory, wherever no anchor is within 25 m; every position belongs to its nearest
       anchor, and anchors visited in succession are joined. So a street driven twice, in either direction and lane, is
       one street, and every edge is about 25 m or longer.
    2. Each anchor moves to the mean, over the passes, of the nearest position of each pass: the centre line.
    3. Until all rules hold, crossings become junctions, nodes under 15 m from a street join it, edges under 25 m are
       contracted, and of two edges that diverge by under 40 degrees the longer starts where the shorter ends. What
       still violates a rule after 200 repairs is dropped, and the largest connected part is kept.
    4. Bends of less than 2 m are straightened where no edge becomes longer than 80 m.
    5. A share ``side_streets`` of the bends gets a side street at right angles: up to the next street if that is
       within ``reach_m``, otherwise 50 to 110 m long, and none where it would pass another street within 30 m.

    Streets driven more than once are avenues 12 m wide; the others are 8 m wide.

    Args:
        positions: metres, in the order of travel.
        seed: of the side streets.
        side_streets: share of the bends for which one is attempted, in [0, 1].
        reach_m: how far ahead a side street may end at another street, in [50, 1000].

    Raises:
        UserError: fewer than two distinct positions, a coordinate that is not finite, a trajectory not 60 m to
            20 km wide along x or y, or a share or reach out of range.

    >>> there = np.arange(0, 400, 10.0)[:, None] * [1, 0]
    >>> ways = there, np.concatenate([there, there[::-1]])
    >>> [float(traced_streets(way, side_streets=0.0).widths.max()) for way in ways]  # there and back: an avenue
    [8.0, 12.0]
    """
    check_range("streets.side_streets", side_streets, 0.0, 1.0)
    check_range("streets.reach_m", reach_m, 50.0, 1000.0)
    path = _resampled(positions)
    town = _anchor_graph(path)
    repair(town)
    prune(town)
    straighten(town)
    if town.number_of_edges() == 0:
        raise UserError("the trajectory goes to and fro in too small an area to make a street", "Use a longer one.")
    add_side_streets(town, np.random.default_rng(seed), side_streets, reach_m)
    prune(town)
    return _as_street_graph(town)


def _resampled(positions: Float[ndarray, "n 2"], step_m: float = 2.0) -> Float[ndarray, "m 2"]:
    """Positions every 2 m of travel."""
    if positions.ndim != 2 or positions.shape[1] != 2 or not np.isfinite(positions).all():
        raise UserError(f"a trajectory needs rows of two finite numbers, got an array of shape {positions.shape}")
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    travelled = np.r_[0.0, np.cumsum(steps)]
    extent = np.ptp(positions, axis=0).max() if len(positions) else 0.0
    if not 60 <= extent <= 20_000:
        raise UserError(
            f"a trajectory of {len(positions)} positions, {travelled[-1]:.1f} m long and {extent:.1f} m wide, "
            "makes no streets: it must be 60 m to 20 km wide",
            "Give positions in metres, or a longer sequence",
        )
    at = np.arange(0.0, travelled[-1], step_m)
    moving = np.r_[True, steps > 0]
    return np.stack([np.interp(at, travelled[moving], positions[moving, k]) for k in (0, 1)], axis=1)


def _anchor_graph(path: Float[ndarray, "m 2"]) -> nx.Graph:
    """Steps 1 and 2. Nodes have ``at``; edges have ``passes``, how often they were driven."""
    anchors = [path[0]]
    for point in path:
        if np.min(np.linalg.norm(np.asarray(anchors) - point, axis=1)) > MERGE_M:
            anchors.append(point)
    distance, visited = _nearest(np.asarray(anchors), path)
    town: nx.Graph = nx.Graph()
    starts = np.flatnonzero(np.r_[True, np.diff(visited) != 0])
    closest: dict[int, list[Float[ndarray, "2"]]] = {}
    for start, stop in pairwise([*starts.tolist(), len(path)]):
        nearest = path[start + int(np.argmin(distance[start:stop]))]
        closest.setdefault(int(visited[start]), []).append(nearest)
    for node, passes in closest.items():
        town.add_node(node, at=np.mean(passes, axis=0))
    for a, b in pairwise(visited[starts].tolist()):
        join(town, a, b, 1)
    return town


def _nearest(
    anchors: Float[ndarray, "a 2"], points: Float[ndarray, "m 2"]
) -> tuple[Float[ndarray, " m"], Int64[ndarray, " m"]]:
    """Distance of each point to its nearest anchor, and that anchor's number."""
    distance, nearest = KDTree(anchors).query(points)
    return np.asarray(distance), np.asarray(nearest, np.int64)


def _as_street_graph(town: nx.Graph) -> StreetGraph:
    number = {node: i for i, node in enumerate(sorted(town))}
    edges = sorted((*sorted((number[a], number[b])), passes) for a, b, passes in town.edges.data("passes"))
    table = np.array(edges, np.int64)
    widths = np.where(table[:, 2] > 1, AVENUE_WIDTH_M, STREET_WIDTH_M)
    return StreetGraph(np.array([town.nodes[node]["at"] for node in sorted(town)]), table[:, :2].copy(), widths)
