from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from worlds.graphs import assert_town

from sextant.errors import UserError
from sextant.worlds.street_layouts import AVENUE_WIDTH_M
from sextant.worlds.traced_streets import traced_streets
from sextant.worlds.trajectories import load_kitti_poses, plane_positions


def polyline(*corners, step=1.0):
    corners = np.array(corners, float)
    pieces = [
        np.linspace(a, b, max(2, int(np.linalg.norm(b - a) / step)), endpoint=False) for a, b in pairwise(corners)
    ]
    return np.concatenate([*pieces, corners[-1:]])


def distance_to_streets(graph, points):
    return shapely.distance(shapely.points(points), shapely.multilinestrings(graph.nodes[graph.edges]))


@given(st.integers(0, 10_000), st.integers(50, 400))
def test_any_wandering_trajectory_makes_a_town(seed, frames):
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(scale=0.25, size=frames))
    heading += np.pi / 2 * np.cumsum(rng.integers(-1, 2, frames) * (rng.uniform(size=frames) < 0.1))
    positions = np.cumsum(5 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    if np.ptp(positions, axis=0).max() >= 100:
        assert_town(traced_streets(positions, seed=seed))


def test_there_and_back_in_two_lanes_is_one_street_in_the_middle():
    graph = traced_streets(polyline((0, 0), (400, 0), (400, 4), (0, 4)), side_streets=0)
    assert graph.length_m == pytest.approx(400, abs=15)
    assert np.median(np.abs(graph.nodes[:, 1] - 2)) < 0.5
    assert np.abs(graph.nodes[:, 1] - 2).max() <= 2
    assert (graph.widths == AVENUE_WIDTH_M).mean() > 0.7


def test_a_figure_of_eight_has_a_junction_where_it_crosses_itself():
    graph = traced_streets(
        polyline((0, 0), (300, 0), (300, 150), (150, 150), (150, -200), (0, -200), (0, 0)), side_streets=0
    )
    crossing = np.argmin(np.linalg.norm(graph.nodes - [150, 0], axis=1))
    assert np.linalg.norm(graph.nodes[crossing] - [150, 0]) < 13
    assert graph.degrees[crossing] == 4


def test_side_streets_are_a_function_of_the_seed():
    trajectory = polyline((0, 0), (400, 0), (400, 400), (0, 400), (0, 20))
    bare, first, same, other = (
        traced_streets(trajectory, seed=seed, side_streets=share)
        for seed, share in ((1, 0), (1, 0.8), (1, 0.8), (2, 0.8))
    )
    assert first.length_m > bare.length_m + 100
    assert np.array_equal(first.nodes, same.nodes)
    assert first.nodes.shape != other.nodes.shape or not np.array_equal(first.nodes, other.nodes)


@pytest.mark.real_data
@pytest.mark.parametrize("sequence", ["00", "01", "03", "04", "05", "06", "07", "09"])
def test_towns_under_kitti_drives(real_data, sequence):
    positions = plane_positions(load_kitti_poses(real_data / "kitti" / "poses" / f"{sequence}.txt"))
    graph = traced_streets(positions)
    assert_town(graph)
    off = distance_to_streets(graph, positions)
    assert np.quantile(off, 0.9) < 12.5  # corners are cut, and the two carriageways of 06 are 16 m apart
    assert off.max() < 40


@pytest.mark.parametrize(
    "positions",
    [
        np.zeros((0, 2)),
        np.zeros((1, 2)),
        np.zeros((9, 2)),
        polyline((0, 0), (40, 0)),
        polyline((0, 0), (3e4, 0), step=100),
    ],
)
def test_a_trajectory_that_makes_no_street_is_told(positions):
    with pytest.raises(UserError, match="60 m to 20 km"):
        traced_streets(positions)


def test_a_trajectory_with_holes_is_told():
    with pytest.raises(UserError, match="finite"):
        traced_streets(np.array([[0, 0], [np.nan, 1], [200, 0]]))


@pytest.mark.parametrize(("option", "value"), [("side_streets", 1.5), ("reach_m", 10.0)])
def test_options_out_of_range_are_told(option, value):
    with pytest.raises(UserError, match=f"streets.{option}={value:g}"):
        traced_streets(polyline((0, 0), (400, 0)), **{option: value})
