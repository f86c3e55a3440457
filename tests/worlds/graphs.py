"""Checks that every layout of streets must pass."""

import networkx as nx
import numpy as np
import shapely


def smallest_angle_rad(graph):
    """Between neighbouring edges at any node."""
    angles = [np.pi]
    for node, others in enumerate(graph.neighbours):
        ray = graph.nodes[list(others)] - graph.nodes[node]
        heading = np.sort(np.arctan2(ray[:, 1], ray[:, 0]))
        if len(heading) > 1:
            angles.append(np.diff(heading, append=heading[0] + 2 * np.pi).min())
    return min(angles)


def assert_town(graph, shortest_m=24.999):
    """Connected, plane, no slivers, no scraps."""
    town = nx.Graph(graph.edges.tolist())
    assert town.number_of_nodes() == len(graph.nodes)
    assert nx.is_connected(town)
    lines = shapely.linestrings(graph.nodes[graph.edges])
    first, second = shapely.STRtree(lines).query(lines, predicate="intersects")
    for i, j in zip(first, second, strict=True):
        assert i == j or set(graph.edges[i]) & set(graph.edges[j]), f"edges {i} and {j} cross"
    assert graph.lengths.min() >= shortest_m
    assert smallest_angle_rad(graph) >= np.deg2rad(39.999)
