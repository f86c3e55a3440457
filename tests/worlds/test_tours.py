import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import grid_streets, irregular_streets
from sextant.worlds.tours import check_nodes, coverage_tour, random_walk


def tree():
    """A street with two dead ends and a side street that is a dead end too."""
    nodes = np.array([[0, 0], [100, 0], [200, 0], [100, 80.0]])
    return StreetGraph(nodes, np.array([[0, 1], [1, 2], [1, 3]]), np.full(3, 7.0))


def turns_round(graph, nodes):
    """Nodes where a route turns round though another street leads on."""
    return [b for a, b, c in zip(nodes, nodes[1:], nodes[2:], strict=False) if a == c and graph.degrees[b] > 1]


@given(st.integers(2, 8), st.integers(0, 10_000))
def test_a_tour_takes_every_street_and_turns_round_in_no_street_that_goes_on(blocks, seed):
    graph = irregular_streets(90.0 * blocks, 90, seed, drop=0.2)
    tour = coverage_tour(graph)
    edges = check_nodes(graph, tour)
    assert set(edges) == set(range(len(graph.edges)))
    assert not turns_round(graph, tour)
    assert len(edges) < 2.5 * len(graph.edges)


def test_a_tour_of_dead_ends_turns_round_in_them():
    tour = coverage_tour(tree())
    assert set(check_nodes(tree(), tour)) == {0, 1, 2}
    assert not turns_round(tree(), tour)


def test_a_tour_of_the_city_is_not_much_longer_than_its_streets():
    graph = irregular_streets(2900, 90, 0)
    edges = check_nodes(graph, coverage_tour(graph))
    assert set(edges) == set(range(len(graph.edges)))
    assert graph.lengths[edges].sum() < 1.4 * graph.length_m


@given(st.integers(0, 10_000), st.floats(1, 3000))
def test_a_random_walk_is_long_enough_and_no_longer_and_never_turns_round(seed, length):
    graph = grid_streets(4, 3, 100, 1, 20)
    walk = random_walk(graph, length, seed, start=5)
    edges = check_nodes(graph, walk)
    assert walk[0] == 5
    assert graph.lengths[edges].sum() >= length > graph.lengths[edges[:-1]].sum()
    assert not turns_round(graph, walk)
    assert walk == random_walk(graph, length, seed, start=5)


def test_a_random_walk_prefers_streets_it_has_not_seen():
    graph = grid_streets(5, 5, 100)
    edges = check_nodes(graph, random_walk(graph, graph.length_m, 0))
    assert len(set(edges)) > 0.7 * len(graph.edges)


@pytest.mark.parametrize(
    ("nodes", "told"),
    [
        ([], "has 0 nodes"),
        ([3], "has 1 nodes"),
        ([0, 99], "no node 99"),
        ([-1, 0], "no node -1"),
        ([0, 2], "no street joins node 0 to node 2"),
        ([0, 0], "no street joins node 0 to node 0"),
    ],
)
def test_a_route_off_the_graph_names_the_node(nodes, told):
    with pytest.raises(UserError, match=told):
        check_nodes(tree(), nodes)


def test_wishes_that_cannot_be_met_are_told():
    with pytest.raises(UserError, match="no node 4"):
        coverage_tour(tree(), start=4)
    with pytest.raises(UserError, match="no node 7"):
        random_walk(tree(), 100, 0, start=7)
    for length in (0, -1, float("nan"), float("inf")):
        with pytest.raises(UserError, match=r"^length_m"):
            random_walk(tree(), length, 0)
