from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.graphs import assert_town

from sextant.errors import UserError
from sextant.worlds.given_streets import MOST_PIECES, given_streets
from sextant.worlds.routes import drive
from sextant.worlds.street_layouts import grid_streets, irregular_streets
from sextant.worlds.tours import coverage_tour


@pytest.mark.parametrize("graph", [grid_streets(4, 3, 90.0, seed=1, jitter_m=5.0), irregular_streets(600.0, 80.0, 4)])
def test_the_streets_of_a_town_come_back(graph):
    found = given_streets([line.copy() for line in graph.nodes[graph.edges]], graph.widths)
    assert len(found.edges) == len(graph.edges)
    assert np.sort(found.lengths) == pytest.approx(np.sort(graph.lengths), rel=0.01)
    assert np.sort(found.widths).tolist() == np.sort(graph.widths).tolist()


@pytest.mark.slow
@given(st.integers(0, 10_000), st.integers(2, 12))
def test_whatever_is_scribbled_makes_a_town_whose_streets_can_all_be_driven(seed, count):
    rng = np.random.default_rng(seed)
    lines = [np.array([[0.0, 0.0], [150.0, 0.0]])]
    for _ in range(count):
        way = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.4, rng.integers(1, 30)))
        steps = rng.uniform(0.5, 40) * np.column_stack([np.cos(way), np.sin(way)])
        lines.append(rng.uniform(-150, 150, 2) + np.cumsum(np.vstack([np.zeros(2), steps]), axis=0))
    graph = given_streets(lines, rng.uniform(4, 20, len(lines)))
    assert_town(graph)
    tour = coverage_tour(graph)
    assert {graph.edge_between(a, b) for a, b in pairwise(tour)} == set(range(len(graph.edges)))
    assert np.isfinite(drive(graph, tour, seed=seed).poses).all()


def test_lines_that_fall_short_or_go_too_far_meet():
    graph = given_streets(
        [np.array([[0.0, 0], [200, 0]]), np.array([[100.0, 4], [100, 90]]), np.array([[40.0, -9], [40, 80]])]
    )
    assert sorted(graph.degrees.tolist()) == [1, 1, 1, 1, 3, 3]
    assert graph.length_m == pytest.approx(200 + 90 + 80, abs=10)


def test_a_roundabout_and_a_dual_carriageway_become_a_junction_and_a_street():
    turn = np.linspace(0, 2 * np.pi, 17)
    ring = 12 * np.column_stack([np.cos(turn), np.sin(turn)])
    arms = [
        np.array([[12.0, 0], [200, 5]]),
        np.array([[12.0, -1], [200, -5]]),
        np.array([[0.0, 12], [0, 200]]),
        np.array([[-12.0, 0], [-200, 0]]),
    ]
    graph = given_streets([ring, *arms])
    assert (graph.degrees > 2).sum() == 1
    assert graph.length_m == pytest.approx(600, abs=40)


def test_a_fine_bend_keeps_its_length():
    turn = np.linspace(0, np.pi, 90)
    graph = given_streets([120 * np.column_stack([np.cos(turn), np.sin(turn)])])
    assert graph.length_m == pytest.approx(120 * np.pi, rel=0.01)
    assert graph.lengths.min() > 24.999


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([], "0 lines"),
        ([np.array([[0, 0], [np.nan, 1]])], "finite"),
        ([np.array([[0.0, 0], [40, 0]])], "60 m to 20 km"),
        ([np.array([[0.0, 0], [3e4, 0]])], "60 m to 20 km"),
        ([np.array([[0.0, 0], [20, 0]]), np.array([[100.0, 0], [120, 0]])], "no street of 25 m"),
        (
            [np.array([[0.0, 30 * k], [9e3, 30 * k]]) for k in range(50)]
            + [np.array([[200.0 * k, 0], [200 * k, 1500]]) for k in range(46)],
            f"{MOST_PIECES:,}",
        ),
    ],
)
def test_lines_that_make_no_town_are_reported(lines, said):
    with pytest.raises(UserError, match=said):
        given_streets(lines)
