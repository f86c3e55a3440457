"""Drives and walks, and the line they keep to."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.worlds.lane_path import lane_path
from sextant.worlds.routes import DRIVER, WALKER, drive, speed_profile, walk
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import grid_streets, irregular_streets
from sextant.worlds.tours import coverage_tour, random_walk

STEADY = replace(DRIVER, lateral_sigma_m=0.0, heading_sigma_rad=0.0, stop_probability=0.0)


def street(*corners, width=8.0):
    nodes = np.array(corners, float)
    edges = np.column_stack([np.arange(len(nodes) - 1), np.arange(1, len(nodes))])
    return StreetGraph(nodes, edges, np.full(len(edges), width))


def difference(a, b):
    return np.angle(np.exp(1j * (a - b)))


def test_a_straight_drive_is_in_the_right_hand_lane_and_a_walk_on_the_right_hand_pavement():
    graph = street((0, 0), (200, 0))
    driven, walked = (
        drive(graph, [0, 1], seed=0, gait=STEADY),
        walk(graph, [0, 1], seed=0, gait=replace(STEADY, speed_mps=1.4)),
    )
    assert np.allclose(driven.poses[:, 1:], [-2, 0])
    assert np.allclose(walked.poses[:, 1:], [-6.1, 0])
    assert np.allclose(drive(graph, [1, 0], seed=0, gait=STEADY).poses[:, 1], 2)
    assert driven.poses[-1, 0] == pytest.approx(200, abs=0.5)


def test_a_straight_drive_takes_as_long_as_physics_says():
    route = drive(street((0, 0), (200, 0)), [0, 1], seed=0, frame_rate_hz=100, gait=STEADY)
    v, a, b = STEADY.speed_mps, STEADY.acceleration_mps2, STEADY.braking_mps2
    expected = v / a + v / b + (200 - v**2 / 2 / a - v**2 / 2 / b) / v
    assert route.times[-1] == pytest.approx(expected, rel=0.01)


def test_a_right_angle_is_turned_on_an_arc():
    corners = {"left": (100, 100), "right": (100, -100)}
    for side, end in corners.items():
        path = lane_path(street((0, 0), (100, 0), end), [0, 1, 2], share=0.25, radius_m=7)
        turn = path.headings[-1] - path.headings[0]
        assert turn == pytest.approx(np.pi / 2 if side == "left" else -np.pi / 2, abs=0.01)
        assert np.abs(path.curvatures).max() == pytest.approx(1 / 7, rel=0.1)


@given(st.integers(0, 10_000), st.booleans())
def test_the_line_is_smooth_continuous_and_near_the_streets(seed, on_foot):
    graph = irregular_streets(720, 90, seed, drop=0.2)
    nodes = random_walk(graph, 1500, seed)
    path = lane_path(
        graph, nodes, share=0.5 if on_foot else 0.25, beyond_m=1.2 * on_foot, radius_m=1.5 if on_foot else 7
    )
    step = np.diff(path.arc_m)
    assert step.min() > 0.05
    assert step.max() < 1.1
    assert np.abs(path.curvatures).max() < (1.0 if on_foot else 0.45)
    off = shapely.distance(shapely.points(path.positions), shapely.linestrings(graph.nodes[graph.edges[path.edges]]))
    assert off.max() < 12
    driven_against = difference(path.headings[:-1], np.arctan2(*np.diff(path.positions, axis=0).T[::-1]))
    assert np.abs(driven_against).max() < 0.6


def test_a_dead_end_is_turned_round_in_on_the_other_side():
    path = lane_path(street((0, 0), (100, 0)), [0, 1, 0], share=0.25)
    assert path.positions[0] == pytest.approx([0, -2])
    assert path.positions[-1] == pytest.approx([0, 2])
    assert path.headings[-1] - path.headings[0] == pytest.approx(np.pi, abs=0.05)
    assert np.abs(path.curvatures).max() < 1.0


@given(st.integers(0, 10_000))
def test_limits_of_speed_and_acceleration_hold(seed):
    graph = grid_streets(4, 4, 90, seed, 15)
    path = lane_path(graph, random_walk(graph, 1000, seed), share=0.25)
    stops = path.stops[::2]
    v = speed_profile(path, stops, DRIVER)
    assert v.max() <= DRIVER.speed_mps
    assert np.all(v[[0, -1, *stops]] == 0)
    assert np.all(v**2 * np.abs(path.curvatures) <= DRIVER.sideways_mps2 + 1e-9)
    acceleration = np.diff(v**2) / 2 / np.diff(path.arc_m)
    assert acceleration.max() <= DRIVER.acceleration_mps2 + 1e-6
    assert acceleration.min() >= -DRIVER.braking_mps2 - 1e-6


@pytest.mark.parametrize(("travel", "gait", "rate"), [(drive, DRIVER, 20), (walk, WALKER, 10)])
def test_frames_keep_to_the_limits_too(travel, gait, rate):
    graph = irregular_streets(540, 90, 3)
    route = travel(graph, random_walk(graph, 1500, 0), seed=1, frame_rate_hz=rate)
    speed = np.diff(route.arc_m) * rate
    assert np.allclose(np.diff(route.times), 1 / rate)
    assert speed.min() >= 0
    assert speed.max() <= gait.speed_mps + 1e-6
    acceleration = np.diff(speed) * rate
    assert acceleration.max() <= gait.acceleration_mps2 + 1e-6
    assert acceleration.min() >= -gait.braking_mps2 - 1e-6
    assert (speed == 0).sum() > rate  # it stopped somewhere
    assert np.abs(difference(route.poses[1:, 2], route.poses[:-1, 2])).max() < 0.5


def test_frames_a_distance_apart_are_the_same_places_on_every_traverse():
    graph = irregular_streets(720, 90, 0)
    nodes = random_walk(graph, 3000, 0)
    first, second, same = (drive(graph, nodes, seed=seed) for seed in (1, 2, 1))
    assert np.array_equal(first.poses, same.poses)
    a, b = first.sample_by_distance(2.0), second.sample_by_distance(2.0)
    assert np.array_equal(a.arc_m, b.arc_m)
    assert np.mean(a.edges == b.edges) > 0.98
    assert np.allclose(np.diff(a.arc_m), 2)
    apart = np.linalg.norm(a.poses[:, :2] - b.poses[:, :2], axis=1)
    assert 0.1 < apart.mean() < 0.5
    assert apart.max() < 1.5
    assert 0.005 < np.std(difference(a.poses[:, 2], b.poses[:, 2])) < 0.06


def test_align_finds_the_frame_at_the_same_place():
    graph = irregular_streets(720, 90, 0)
    nodes = random_walk(graph, 2000, 0)
    first, second = drive(graph, nodes, seed=1), drive(graph, nodes, seed=2, frame_rate_hz=7)
    match = first.align(second)
    expected = np.abs(first.arc_m[:, None] - second.arc_m).min(axis=1)
    assert np.allclose(np.abs(first.arc_m - second.arc_m[match]), expected)


def test_the_city_is_driven_in_seconds_and_gives_the_frames_asked_for():
    graph = irregular_streets(2900, 90, 0)
    route = drive(graph, coverage_tour(graph), seed=0).sample_by_distance(1.0)
    assert len(route.times) > 172_000
    assert set(route.edges) == set(range(len(graph.edges)))
    assert np.all(np.diff(route.times) > 0)


def test_wander_has_the_spread_it_states():
    graph = street((0, 0), (60_000, 0))
    lateral = drive(graph, [0, 1], seed=0).sample_by_distance(5.0).poses[:, 1] + 2
    assert lateral.std() == pytest.approx(DRIVER.lateral_sigma_m, rel=0.1)
    gaze = drive(graph, [0, 1], seed=0, gait=replace(DRIVER, lateral_sigma_m=0.0)).poses[:, 2]
    assert gaze.std() == pytest.approx(DRIVER.heading_sigma_rad, rel=0.1)


def test_a_car_that_wanders_far_goes_from_kerb_to_kerb():
    graph = street((0, 0), (20_000, 0))
    across = drive(graph, [0, 1], seed=0, gait=replace(DRIVER, lateral_sigma_m=3.0)).poses[:, 1]
    half = graph.widths[0] / 2
    assert (across.min(), across.max()) == pytest.approx((-half, half))


@pytest.mark.parametrize("rate", [0, -1, 2000, float("nan")])
def test_an_impossible_frame_rate_is_told(rate):
    with pytest.raises(UserError, match=r"frame_rate_hz"):
        drive(street((0, 0), (100, 0)), [0, 1], seed=0, frame_rate_hz=rate)


@pytest.mark.parametrize("step", [0, -1, float("nan"), 1e-9])
def test_an_impossible_step_is_told(step):
    with pytest.raises(UserError, match=r"step_m"):
        drive(street((0, 0), (100, 0)), [0, 1], seed=0).sample_by_distance(step)


def test_a_route_off_the_graph_is_told():
    with pytest.raises(UserError, match="no node 5"):
        drive(street((0, 0), (100, 0)), [0, 5], seed=0)
    with pytest.raises(UserError, match="at least two"):
        walk(street((0, 0), (100, 0)), [0], seed=0)
