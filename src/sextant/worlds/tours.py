"""Ways through a town: sequences of nodes of a street graph."""

import heapq
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sextant.errors import UserError
from sextant.worlds.street_graph import StreetGraph


def check_nodes(graph: StreetGraph, nodes: Sequence[int]) -> list[int]:
    """The edges along a sequence of nodes.

    Raises:
        UserError: fewer than two nodes, a node that is not in the graph, or two successive nodes without an edge.
    """
    if len(nodes) < 2:
        raise UserError(
            f"nodes={list(nodes)} has {len(nodes)} nodes: a route needs at least two",
            f"Try nodes={[0, *graph.neighbours[0][:1]]}",
        )
    for node in nodes:
        _check_node(graph, node)
    edges = [graph.edge_between(a, b) for a, b in pairwise(nodes)]
    for (a, b), edge in zip(pairwise(nodes), edges, strict=True):
        if edge is None:
            raise UserError(
                f"nodes: no street joins node {a} to node {b}",
                f"From node {a} there are streets to {list(graph.neighbours[a])}",
            )
    return [edge for edge in edges if edge is not None]


def random_walk(graph: StreetGraph, length_m: float, seed: int, start: int | None = None) -> list[int]:
    """Nodes of a random walk of at least ``length_m`` metres that turns round only in dead ends.

    At every node it takes the street driven least often so far, at random among equals, and so spreads over the town.

    Raises:
        UserError: ``length_m`` is not positive and finite or would take more than a million nodes; ``start`` is not
            a node of the graph, or no street leads from it.

    >>> from sextant.worlds import grid_streets
    >>> random_walk(grid_streets(2, 1, spacing_m=100.0), length_m=250.0, seed=0)  # three streets of 100 m
    [5, 4, 3, 0]
    """
    if not 0 < length_m < 1e6 * float(np.mean(graph.lengths)):
        limit = 1e6 * float(np.mean(graph.lengths))
        raise UserError(f"length_m={length_m:g} is out of range: it must be in (0, {limit:.3g})", "Try 2000")
    rng = np.random.default_rng(seed)
    first = int(rng.choice(np.flatnonzero(graph.degrees))) if start is None else _check_node(graph, start)
    nodes, driven, visits = [first], 0.0, np.zeros(len(graph.edges), np.int64)
    while driven < length_m:
        options = _onward(graph, nodes[-2] if len(nodes) > 1 else None, nodes[-1])
        edges = [graph.edge_between(nodes[-1], option) or 0 for option in options]
        least = [i for i, edge in enumerate(edges) if visits[edge] == visits[edges].min()]
        chosen = int(rng.choice(least))
        visits[edges[chosen]] += 1
        driven += graph.lengths[edges[chosen]]
        nodes.append(options[chosen])
    return nodes


def coverage_tour(graph: StreetGraph, start: int = 0) -> list[int]:
    """Nodes of a tour that takes every street at least once, in either direction, and turns round only in dead ends.

    Greedy: continue along the street not taken yet that turns least; where there is none, take the shortest way to the
    nearest such street without turning round. On town layouts the tour is 1.2 to 1.5 times as long as the streets.
    From a node that is not connected to all streets, the tour covers those that can be reached.

    Raises:
        UserError: ``start`` is not a node of the graph, or no street leads from it.

    >>> from sextant.worlds import grid_streets
    >>> coverage_tour(grid_streets(2, 1, spacing_m=100.0))  # round both blocks, then on to the street between them
    [0, 1, 2, 5, 4, 3, 0, 1, 4]
    """
    nodes = [_check_node(graph, start)]
    fresh = set(range(len(graph.edges)))
    behind: int | None = None
    while way := _way_to_fresh(graph, behind, nodes[-1], fresh):
        for node in way:
            fresh.discard(graph.edge_between(nodes[-1], node) or 0)
            nodes.append(node)
        behind = nodes[-2]
    return nodes


def _check_node(graph: StreetGraph, node: int) -> int:
    if not 0 <= node < len(graph.nodes):
        raise UserError(f"route: there is no node {node}: the town has nodes 0 to {len(graph.nodes) - 1}")
    if not graph.neighbours[node]:
        raise UserError(f"route: no street leads from node {node}", f"Try node {int(graph.edges[0, 0])}")
    return int(node)


def _onward(graph: StreetGraph, behind: int | None, node: int) -> list[int]:
    """Where one can go from a node without turning round, or back if there is no other way."""
    return [other for other in graph.neighbours[node] if other != behind] or list(graph.neighbours[node])


def _way_to_fresh(graph: StreetGraph, behind: int | None, node: int, fresh: set[int]) -> list[int]:
    """Nodes after ``node`` up to the end of the nearest street in ``fresh``; none if none can be reached.

    Dijkstra's algorithm over directed edges; of streets that start at the same distance, the straightest comes first.
    """
    if not fresh:
        return []
    queue: list[tuple[float, float, int, int | None]] = [(0.0, 0.0, node, behind)]
    came: dict[tuple[int | None, int], tuple[int | None, int] | None] = {(behind, node): None}
    distance: dict[tuple[int | None, int], float] = {(behind, node): 0.0}
    while queue:
        travelled, _, here, back = heapq.heappop(queue)
        state = (back, here)
        if travelled > distance[state]:
            continue
        options = _onward(graph, back, here)
        edges = {option: graph.edge_between(here, option) or 0 for option in options}
        found = [option for option in options if edges[option] in fresh]
        if found:
            return [*_trail(came, state), min(found, key=lambda option: _turn(graph, back, here, option))]
        for option in options:
            further, ahead = travelled + float(graph.lengths[edges[option]]), (here, option)
            if further < distance.get(ahead, np.inf):
                distance[ahead], came[ahead] = further, state
                heapq.heappush(queue, (further, _turn(graph, back, here, option), option, here))
    return []


def _trail(
    came: dict[tuple[int | None, int], tuple[int | None, int] | None], state: tuple[int | None, int]
) -> list[int]:
    nodes: list[int] = []
    at: tuple[int | None, int] | None = state
    while at is not None and came[at] is not None:
        nodes.append(at[1])
        at = came[at]
    return nodes[::-1]


def _turn(graph: StreetGraph, behind: int | None, node: int, ahead: int) -> float:
    """Angle turned at a node, in [0, pi]."""
    if behind is None:
        return 0.0
    u, v = graph.nodes[node] - graph.nodes[behind], graph.nodes[ahead] - graph.nodes[node]
    return float(np.arctan2(abs(u[0] * v[1] - u[1] * v[0]), u @ v))
