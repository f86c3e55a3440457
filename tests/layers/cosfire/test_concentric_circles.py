"""Parts on circles of made-up maps whose peaks are known."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.layers.cosfire import ConcentricCircles

GRID = torch.tensor([[4.0, 0.0], [8.0, 0.0], [4.0, 1.0], [8.0, 1.0]], dtype=torch.float64)
CENTRE = (30, 30)


def maps_with(*dots, count=4):
    """Maps of nothing but dots (channel, ρ, degrees, strength)."""
    maps = torch.zeros(count, 61, 61, dtype=torch.float64)
    for channel, rho, degrees, strength in dots:
        row = round(30 - rho * math.sin(math.radians(degrees)))
        column = round(30 + rho * math.cos(math.radians(degrees)))
        maps[channel, row, column] = strength
    return maps


def found(strategy, maps, point=CENTRE):
    tuples = strategy.tuples(maps, GRID[: len(maps)], point)
    channels = [GRID.tolist().index(row) for row in tuples.channels.tolist()]
    degrees = [math.degrees(phi) for phi in tuples.phi.tolist()]
    return list(zip(channels, tuples.rho.tolist(), degrees, strict=True))


@given(st.lists(st.integers(0, 11), min_size=1, max_size=6, unique=True), st.sampled_from([10.0, 20.0]))
def test_dots_on_a_circle_are_found_where_they_are(turns, radius):
    dots = [(turn % 4, radius, 30 * turn, 1 + turn / 100) for turn in turns]
    parts = found(ConcentricCircles((radius,), apart_deg=10.0), maps_with(*dots))
    assert len(parts) == len(dots)
    for channel, rho, degrees in parts:
        assert rho == radius
        nearest = min(dots, key=lambda dot: abs((dot[2] - degrees + 180) % 360 - 180))
        assert channel == nearest[0]
        assert abs((nearest[2] - degrees + 180) % 360 - 180) <= math.degrees(1 / radius)


def test_the_centre_is_one_place():
    assert found(ConcentricCircles((0.0, 5.0)), maps_with((2, 0, 0, 1.0))) == [(2, 0.0, 0.0)]


def test_a_plateau_counts_once_in_its_middle():
    maps = torch.zeros(1, 61, 61, dtype=torch.float64)
    rows, columns = np.mgrid[30:-31:-1, -30:31]
    angle = np.degrees(np.arctan2(rows, columns))
    maps[0] = torch.from_numpy((np.abs(angle - 50) <= 20.0).astype(float))
    ((_, _, degrees),) = found(ConcentricCircles((25.0,)), maps)
    assert degrees == pytest.approx(50, abs=2)


def test_a_plateau_across_360_degrees_counts_once():
    maps = torch.zeros(1, 61, 61, dtype=torch.float64)
    maps[0, 20:41, 31:] = 1
    ((_, _, degrees),) = found(ConcentricCircles((20.0,)), maps)
    assert (degrees + 180) % 360 - 180 == pytest.approx(0, abs=1)


@pytest.mark.parametrize("apart", [20.0, 60.0])
@pytest.mark.parametrize(("weak", "strong"), [(350, 30), (30, 350), (100, 140)])
def test_of_peaks_too_near_each_other_the_stronger_stays_also_across_360_degrees(apart, weak, strong):
    parts = found(ConcentricCircles((20.0,), apart_deg=apart), maps_with((0, 20, weak, 1.0), (0, 20, strong, 2.0)))
    assert len(parts) == (2 if apart == 20 else 1)
    assert any(part[2] == pytest.approx(strong, abs=3) for part in parts)


def test_channels_are_kept_from_a_share_of_the_strongest_of_the_place_or_of_the_example():
    maps = maps_with((0, 0, 0, 1.0), (2, 0, 0, 0.8), (3, 0, 0, 0.7), (1, 20, 90, 2.0))
    options = {"radii": (0.0,), "t2": 0.75, "one_of": False}
    assert [part[0] for part in found(ConcentricCircles(**options), maps)] == [0, 2]
    assert found(ConcentricCircles(**options, relative_to="example"), maps) == []
    assert len(found(ConcentricCircles(**options | {"t2": 0.4}, relative_to="example"), maps)) == 2


def test_of_channels_that_differ_in_their_first_number_alone_the_strongest_is_kept():
    maps = maps_with((0, 0, 0, 0.9), (1, 0, 0, 1.0), (2, 0, 0, 0.95), (3, 0, 0, 0.9))
    assert [part[0] for part in found(ConcentricCircles((0.0,)), maps)] == [1, 2]
    assert [part[0] for part in found(ConcentricCircles((0.0,), one_of=False), maps)] == [0, 1, 2, 3]


def test_channels_of_one_number_are_no_rivals():
    maps, grid = torch.ones(3, 9, 9, dtype=torch.float64), torch.arange(3, dtype=torch.float64)[:, None]
    assert ConcentricCircles((0.0,)).tuples(maps, grid, (4, 4)).channels[:, 0].tolist() == [0, 1, 2]


def test_what_is_level_has_no_parts_on_circles_and_what_is_nothing_none_at_all():
    assert found(ConcentricCircles((5.0, 20.0)), torch.ones(4, 61, 61)) == []
    assert found(ConcentricCircles((0.0, 5.0)), torch.zeros(4, 61, 61)) == []


def test_outside_the_maps_there_is_nothing():
    maps = torch.zeros(1, 61, 61)
    maps[0, :, 0] = 1
    parts = found(ConcentricCircles((0.0, 10.0)), maps, point=(30, 0))
    assert [(rho, round(degrees)) for _, rho, degrees in parts] == [(0.0, 0), (10.0, 90), (10.0, 270)]
