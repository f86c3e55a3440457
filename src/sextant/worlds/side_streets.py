"""Side streets for a street graph under construction; see `street_repair` for its form."""

import networkx as nx
import numpy as np
from jaxtyping import Float
from numpy import ndarray
from shapely import LineString, Point

from sextant.worlds.street_layouts import MIN_EDGE_M
from sextant.worlds.street_repair import angle, edge_length, join, segment, split_edge


def add_side_streets(town: nx.Graph, rng: np.random.Generator, share: float, reach_m: float) -> None:
    """Try to give a share of the bends a side street on one side or both; see `traced_streets`."""
    for node in sorted(town):
        wanted, length = rng.uniform() < share, rng.uniform(50.0, 110.0)
        sides = rng.permutation([-1.0, 1.0])[: 1 + int(rng.uniform() < 0.5)]
        if not wanted or town.degree(node) != 2:
            continue
        here = town.nodes[node]["at"]
        a, b = (town.nodes[other]["at"] for other in town[node])
        across = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(a - b)
        for side in sides:
            _add_side_street(town, node, side * across, here, length, reach_m)


def _add_side_street(
    town: nx.Graph, node: int, along: Float[ndarray, "2"], here: Float[ndarray, "2"], length: float, reach_m: float
) -> None:
    """One side street from ``here``, if there is room for it."""
    edges = [edge for edge in town.edges if node not in edge]
    lines = [segment(town, *edge) for edge in edges]
    ray = LineString([here + MIN_EDGE_M * along, here + reach_m * along])
    met = [(line.intersection(ray), edge) for edge, line in zip(edges, lines, strict=True)]
    hits = [(Point(here).distance(point), edge) for point, edge in met if not point.is_empty]
    new, target, through = max(town) + 1, here + length * along, None
    if hits:
        reach, edge = min(hits)
        target = here + reach * along
        ends = sorted(edge, key=lambda end: float(np.linalg.norm(town.nodes[end]["at"] - target)))
        if np.linalg.norm(town.nodes[ends[0]]["at"] - target) < MIN_EDGE_M + 5:
            new, target = ends[0], town.nodes[ends[0]]["at"]
        elif edge_length(town, *edge) > 2 * MIN_EDGE_M + 10:
            through = edge
        else:
            return
    trial = town.copy()
    trial.add_node(new, at=target)
    if through is not None:
        split_edge(trial, through, new)
    join(trial, node, new, 1)
    if _has_room(trial, node, new):
        town.add_node(new, at=target)
        if through is not None:
            split_edge(town, through, new)
        join(town, node, new, 1)


def _has_room(town: nx.Graph, a: int, b: int, clearance_m: float = 30.0, angle_rad: float = np.pi / 3) -> bool:
    """Whether the edge from a to b is long enough, clear of other streets, and branches off at wide angles."""
    line = segment(town, a, b)
    if line.length < MIN_EDGE_M + 5:
        return False
    for end, other in ((a, b), (b, a)):
        if any(angle(town, end, other, third) < angle_rad for third in town[end] if third != other):
            return False
    for edge in town.edges:
        shared = {a, b} & set(edge)
        if len(shared) < 2 and segment(town, *edge).distance(line) < (clearance_m if not shared else 0.0):
            return False
    return True
