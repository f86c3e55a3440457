import numpy as np
import pytest
import shapely
from jaxtyping import TypeCheckError

from sextant.worlds.street_graph import StreetGraph


def square(side=100.0):
    corners = side * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    return StreetGraph(corners, np.array([[0, 1], [1, 2], [2, 3], [3, 0]]), np.full(4, 7.0))


def test_lengths_neighbours_and_edges_of_a_square():
    graph = square()
    assert graph.length_m == 400
    assert graph.neighbours == ((1, 3), (2, 0), (1, 3), (0, 2))
    assert graph.degrees.tolist() == [2, 2, 2, 2]
    assert graph.edge_between(0, 3) == graph.edge_between(3, 0) == 3
    assert graph.edge_between(0, 2) is None
    assert graph.bounds == (0, 0, 100, 100)


def test_area_is_the_hull_widened_by_half_a_block():
    graph = square()
    half = 2 * 100**2 / 400 / 2  # half of min(2 A / L, median edge)
    assert graph.block_m == 2 * half
    rounded = 100**2 + 400 * half + np.pi * half**2
    assert graph.area_km2 * 1e6 == pytest.approx(rounded, rel=0.01)
    assert graph.area_km2 * 1e6 <= rounded


def test_a_street_without_a_block_opens_up_no_land():
    line = StreetGraph(np.array([[0, 0], [500.0, 0]]), np.array([[0, 1]]), np.array([7.0]))
    assert line.area_km2 == 0


def test_area_does_not_depend_on_where_and_how_the_town_lies():
    graph, turn = square(), np.array([[0.6, -0.8], [0.8, 0.6]])
    moved = StreetGraph(graph.nodes @ turn.T + [1e4, -300], graph.edges, graph.widths)
    assert moved.area_km2 == pytest.approx(graph.area_km2, rel=1e-3)
    assert shapely.MultiPoint(moved.nodes).convex_hull.area == pytest.approx(100**2)


@pytest.mark.parametrize(
    ("edges", "widths"),
    [
        ([[0, 4]], [7.0]),
        ([[-1, 0]], [7.0]),
        ([[1, 1]], [7.0]),
        ([[0, 1], [1, 0]], [7.0, 7.0]),
        ([[0, 1]], [0.0]),
        ([[0, 1]], [np.nan]),
        ([[0, 1]], [7.0, 7.0]),
        (np.zeros((0, 2)), []),
    ],
)
def test_what_is_no_graph_is_refused(edges, widths):
    with pytest.raises((ValueError, TypeCheckError)):
        StreetGraph(square().nodes, np.array(edges, np.int64), np.array(widths, np.float64))
