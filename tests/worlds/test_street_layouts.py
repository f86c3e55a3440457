import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.graphs import assert_town

from sextant.errors import UserError
from sextant.worlds.street_layouts import AVENUE_WIDTH_M, grid_streets, irregular_streets

seeds = st.integers(0, 2**32 - 1)


@given(st.integers(1, 9), st.integers(1, 9), st.floats(42, 300), seeds, st.floats(0, 1))
def test_every_grid_is_a_town(columns, rows, spacing, seed, jitter):
    graph = grid_streets(columns, rows, spacing, seed, jitter * spacing / 5)
    assert_town(graph)
    assert len(graph.nodes) == (columns + 1) * (rows + 1)
    assert len(graph.edges) == columns * (rows + 1) + rows * (columns + 1)


@given(st.floats(42, 150), st.floats(2, 14), seeds, st.floats(0, 0.3))
def test_every_irregular_town_is_one_within_its_bounds_and_without_dead_ends(block, blocks, seed, drop):
    graph = irregular_streets(block * blocks, block, seed, drop)
    assert_town(graph, min(24.999, 0.599 * block * blocks / round(blocks)))
    assert graph.degrees.min() >= 2
    assert graph.nodes.min() >= 0
    assert graph.nodes.max() <= block * blocks
    assert graph.area_km2 * 1e6 <= (block * blocks) ** 2 * 1.0001


def test_a_grid_without_jitter_is_where_it_says():
    graph = grid_streets(3, 2, 100)
    assert graph.nodes[2 * 4 + 3].tolist() == [300, 200]
    assert graph.length_m == 100 * (3 * 3 + 2 * 4)
    assert (graph.widths == AVENUE_WIDTH_M).any()
    assert (graph.widths < AVENUE_WIDTH_M).any()


def test_a_city_of_eight_square_kilometres_is_built_in_seconds():
    started = time.perf_counter()
    graph = irregular_streets(2900, 90, 0)
    assert time.perf_counter() - started < 5
    assert 8.0 <= graph.area_km2 <= 2.9**2
    assert 155_000 < graph.length_m < 185_000
    assert len(np.unique(graph.degrees)) == 3  # bends, T-junctions and crossings


def test_a_layout_is_a_function_of_its_seed():
    first, same, other = (irregular_streets(900, 90, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.nodes, same.nodes)
    assert np.array_equal(first.edges, same.edges)
    assert not np.array_equal(first.nodes, other.nodes)


@pytest.mark.parametrize(
    ("build", "key"),
    [
        (lambda: irregular_streets(0, 90, 0), "streets.size_m=0"),
        (lambda: irregular_streets(-5, 90, 0), "streets.size_m=-5"),
        (lambda: irregular_streets(float("nan"), 90, 0), "streets.size_m=nan"),
        (lambda: irregular_streets(500, 600, 0), "streets.block_m=600"),
        (lambda: irregular_streets(500, 3, 0), "streets.block_m=3"),
        (lambda: irregular_streets(1e6, 90, 0), "streets.size_m=1e"),
        (lambda: irregular_streets(20_000, 40, 0), "too many"),
        (lambda: irregular_streets(900, 90, 0, drop=0.9), "streets.drop=0.9"),
        (lambda: grid_streets(0, 3, 100), "streets.columns=0"),
        (lambda: grid_streets(3, 0, 100), "streets.rows=0"),
        (lambda: grid_streets(3, 3, 10), "streets.spacing_m=10"),
        (lambda: grid_streets(3, 3, 100, 0, 40), "streets.jitter_m=40"),
        (lambda: grid_streets(1000, 1000, 100), "too many"),
    ],
)
def test_impossible_sizes_are_told_with_key_value_and_fix(build, key):
    with pytest.raises(UserError, match=key) as error:
        build()
    assert error.value.fix
