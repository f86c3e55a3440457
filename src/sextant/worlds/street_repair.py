"""Repairs of a street graph under construction: a networkx graph with ``at`` of nodes and ``passes`` of edges.

``at`` is a position in metres, ``passes`` how often an edge was driven.
"""

from collections.abc import Iterator
from itertools import combinations

import networkx as nx
import numpy as np
import shapely
from shapely import LineString, Point

from sextant.worlds.street_layouts import MIN_ANGLE_RAD, MIN_EDGE_M

REPAIRS = 200


def join(town: nx.Graph, a: int, b: int, passes: int) -> None:
    """Add an edge, or its passes to the edge that exists."""
    if a != b:
        town.add_edge(a, b, passes=passes + (town[a][b]["passes"] if town.has_edge(a, b) else 0))


def segment(town: nx.Graph, a: int, b: int) -> LineString:
    """The piece of street between two nodes."""
    return LineString([town.nodes[a]["at"], town.nodes[b]["at"]])


def edge_length(town: nx.Graph, a: int, b: int) -> float:
    """Metres between two nodes."""
    return float(np.linalg.norm(town.nodes[a]["at"] - town.nodes[b]["at"]))


def repair(town: nx.Graph, most: int = REPAIRS) -> None:
    """Step 3: one repair at a time, the most serious kind first."""
    for _ in range(most):
        if not (_merge_short(town) or _split_crossing(town) or _split_near(town) or _zip_sharp(town)):
            return


def _merge_short(town: nx.Graph) -> bool:
    """Contract the shortest edge, if it is too short."""
    length, a, b = min((edge_length(town, a, b), a, b) for a, b in town.edges)
    if length >= MIN_EDGE_M or town.number_of_edges() == 1:
        return False
    fixed = [node for node in (a, b) if town.degree(node) != 2] or [a, b]  # a junction's position beats a bend's
    town.nodes[a]["at"] = np.mean([town.nodes[node]["at"] for node in fixed], axis=0)
    _replace(town, b, a)
    return True


def _replace(town: nx.Graph, old: int, new: int) -> None:
    for other in list(town[old]):
        join(town, new, other, town[old][other]["passes"])
    town.remove_node(old)


def _crossings(town: nx.Graph) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Pairs of edges that meet although they share no node."""
    edges = sorted(tuple(sorted(edge)) for edge in town.edges)
    lines = [segment(town, *edge) for edge in edges]
    for i, j in np.sort(shapely.STRtree(lines).query(lines, predicate="intersects").T, axis=1):
        if i < j and not set(edges[i]) & set(edges[j]):
            yield edges[i], edges[j]


def _split_crossing(town: nx.Graph) -> bool:
    """Make the first crossing a junction."""
    for first, second in _crossings(town):
        where = segment(town, *first).intersection(segment(town, *second)).representative_point()
        node = max(town) + 1
        town.add_node(node, at=np.array([where.x, where.y]))
        for edge in (first, second):
            split_edge(town, edge, node)
        return True
    return False


def split_edge(town: nx.Graph, edge: tuple[int, int], node: int) -> None:
    """Route an edge through a node."""
    passes = town.edges[edge]["passes"]
    town.remove_edge(*edge)
    for end in edge:
        join(town, end, node, passes)


def _split_near(town: nx.Graph, clearance_m: float = 15.0) -> bool:
    """Route a street through the first node that it passes too closely."""
    edges = sorted(tuple(sorted(edge)) for edge in town.edges)
    nodes = sorted(town)
    lines = [segment(town, *edge) for edge in edges]
    points = [Point(town.nodes[node]["at"]) for node in nodes]
    for i, j in shapely.STRtree(lines).query(points, predicate="dwithin", distance=clearance_m).T.tolist():
        if nodes[i] not in edges[j]:
            split_edge(town, edges[j], nodes[i])
            return True
    return False


def angle(town: nx.Graph, node: int, a: int, b: int) -> float:
    """Angle between two edges at a node, in [0, pi]."""
    u, v = town.nodes[a]["at"] - town.nodes[node]["at"], town.nodes[b]["at"] - town.nodes[node]["at"]
    return float(np.arctan2(abs(u[0] * v[1] - u[1] * v[0]), u @ v))


def sharp_corners(town: nx.Graph) -> Iterator[tuple[int, int, int]]:
    """A node and its two neighbours, the nearer first, where the edges to them diverge by under 40 degrees."""
    for node in sorted(town):
        for a, b in combinations(sorted(town[node]), 2):
            if angle(town, node, a, b) < MIN_ANGLE_RAD:
                yield (node, a, b) if edge_length(town, node, a) <= edge_length(town, node, b) else (node, b, a)


def _zip_sharp(town: nx.Graph) -> bool:
    """Make the longer of two edges start where the shorter one ends."""
    for node, near, far in sharp_corners(town):
        passes = town[node][far]["passes"]
        town.remove_edge(node, far)
        town[node][near]["passes"] += passes
        join(town, near, far, passes)
        return True
    return False


def prune(town: nx.Graph) -> None:
    """Drop what still violates the rules, and all but the largest connected part."""
    for edge in [edge for edge in town.edges if edge_length(town, *edge) < MIN_EDGE_M - 1e-9]:
        town.remove_edge(*edge)
    while found := next(_crossings(town), None):
        town.remove_edge(*max(found, key=lambda edge: edge_length(town, *edge)))
    while sharp := next(sharp_corners(town), None):
        town.remove_edge(sharp[0], sharp[2])
    parts = list(nx.connected_components(town))
    largest = max(parts, key=lambda part: (town.subgraph(part).size(), -min(part)))
    town.remove_nodes_from([node for part in parts if part is not largest for node in part])


def straighten(town: nx.Graph, tolerance_m: float = 2.0, longest_m: float = 80.0) -> None:
    """Step 4: remove bends that lie on the line between their neighbours."""
    for node in sorted(town):
        if town.degree(node) != 2:
            continue
        a, b = town[node]
        flat = segment(town, a, b).distance(Point(town.nodes[node]["at"])) < tolerance_m
        if flat and edge_length(town, a, b) <= longest_m and not town.has_edge(a, b):
            passes = min(town[node][a]["passes"], town[node][b]["passes"])
            before = town.copy()
            town.remove_node(node)
            join(town, a, b, passes)
            if any(corner in (a, b) for corner, _, _ in sharp_corners(town.subgraph({a, b, *town[a], *town[b]}))):
                town.add_node(node, **before.nodes[node])
                town.add_edges_from([(node, a, before[node][a]), (node, b, before[node][b])])
                town.remove_edge(a, b)
