"""Strategies A and B on made-up feature maps whose peaks are known."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.layers.cosfire import ChannelPeaks, VectorKeypoints
from sextant.layers.cosfire.strategies import keep_apart, peaks

GRID = torch.arange(3, dtype=torch.float64)[:, None]
places = st.tuples(st.integers(1, 9), st.integers(1, 9))


def maps_with(*dots):
    """Three maps of nothing but dots (channel, row, column, strength)."""
    maps = torch.zeros(3, 11, 11)
    for channel, row, column, strength in dots:
        maps[channel, row, column] = strength
    return maps


def places_of(tuples, point):
    """(channel or vector, row, column) of the parts."""
    columns = [
        point[1] + rho * math.cos(phi) for rho, phi in zip(tuples.rho.tolist(), tuples.phi.tolist(), strict=True)
    ]
    rows = [point[0] - rho * math.sin(phi) for rho, phi in zip(tuples.rho.tolist(), tuples.phi.tolist(), strict=True)]
    return [
        (channel[0] if len(channel) == 1 else channel, round(row, 9), round(column, 9))
        for channel, row, column in zip(tuples.channels.tolist(), rows, columns, strict=True)
    ]


@given(st.lists(places, min_size=1, max_size=5, unique=True), places)
def test_peaks_of_channels_are_parts_where_they_are(dots, point):
    maps = maps_with(*((index % 3, *dot, 1 + 0.1 * index) for index, dot in enumerate(dots)))
    tuples = ChannelPeaks(window=1, reach=20.0, apart=0.0).tuples(maps, GRID, point)
    alone = {
        (float(index % 3), *map(float, dot))
        for index, dot in enumerate(dots)
        if not any(
            max(abs(dot[0] - other[0]), abs(dot[1] - other[1])) <= 1
            for later, other in enumerate(dots)
            if later > index and later % 3 == index % 3
        )
    }
    assert set(places_of(tuples, point)) == alone


def test_channels_are_kept_by_share_of_their_place_and_of_the_example():
    maps = maps_with((0, 5, 5, 1.0), (1, 5, 5, 0.8), (2, 5, 5, 0.7), (0, 2, 2, 0.1))
    parts = places_of(ChannelPeaks(t2=0.75, strength=0.2, apart=0.0).tuples(maps, GRID, (5, 5)), (5, 5))
    assert parts == [(0.0, 5.0, 5.0), (1.0, 5.0, 5.0)]
    assert len(ChannelPeaks(t2=0.75, strength=0.05, apart=0.0).tuples(maps, GRID, (5, 5))) == 3


def test_only_the_strongest_within_reach_and_apart_become_parts():
    maps = maps_with((0, 5, 5, 1.0), (0, 5, 7, 0.9), (0, 5, 10, 2.0), (0, 1, 5, 0.8))
    options = {"window": 1, "t2": 0.5, "strength": 0.1}
    near = places_of(ChannelPeaks(reach=4.0, **options).tuples(maps, GRID, (5, 5)), (5, 5))
    assert near == [(0.0, 5.0, 5.0), (0.0, 5.0, 7.0), (0.0, 1.0, 5.0)]
    apart = places_of(ChannelPeaks(reach=4.0, apart=3.0, **options).tuples(maps, GRID, (5, 5)), (5, 5))
    assert apart == [(0.0, 5.0, 5.0), (0.0, 1.0, 5.0)]
    assert len(ChannelPeaks(reach=4.0, most=2, **options).tuples(maps, GRID, (5, 5))) == 2


def test_vectors_are_parts_where_they_are_longest_and_have_length_one():
    maps = maps_with((0, 4, 4, 3.0), (1, 4, 4, 4.0), (2, 8, 2, 2.0))
    parts = places_of(VectorKeypoints(reach=20.0, strength=0.3).tuples(maps, torch.eye(3).double(), (5, 5)), (5, 5))
    (first, *where), (second, *there) = parts
    assert (where, there) == ([4.0, 4.0], [8.0, 2.0])
    torch.testing.assert_close(torch.tensor([first, second]), torch.tensor([[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]))


def test_without_a_window_whatever_is_strong_enough_is_a_part():
    maps = torch.ones(3, 11, 11)
    assert len(ChannelPeaks(reach=1.0, apart=0.0).tuples(maps, GRID, (5, 5))) == 0  # level
    assert len(ChannelPeaks(window=0, reach=1.0, apart=0.0).tuples(maps, GRID, (5, 5))) == 15
    assert len(VectorKeypoints(window=0, reach=1.0).tuples(maps, torch.eye(3).double(), (5, 5))) == 5


@pytest.mark.parametrize("strategy", [ChannelPeaks(), VectorKeypoints()])
def test_where_nothing_is_there_are_no_parts(strategy):
    assert len(strategy.tuples(torch.zeros(3, 11, 11), torch.eye(3).double(), (5, 5))) == 0


@given(st.integers(0, 99), st.integers(1, 2))
def test_a_peak_is_the_largest_of_its_square(seed, window):
    maps = torch.rand(2, 8, 9, generator=torch.Generator().manual_seed(seed))
    found = peaks(maps, window)
    for k, y, x in torch.cartesian_prod(torch.arange(2), torch.arange(8), torch.arange(9)).tolist():
        square = maps[k, max(0, y - window) : y + window + 1, max(0, x - window) : x + window + 1]
        assert bool(found[k, y, x]) == bool(maps[k, y, x] == square.max())


def test_what_is_kept_apart_is_the_strongest_first():
    strength, x = torch.tensor([1.0, 3.0, 2.0, 4.0]), torch.tensor([0, 2, 3, 9])
    assert keep_apart(strength, torch.zeros_like(x), x, 2.0, 9) == [3, 1, 0]
    assert keep_apart(strength, torch.zeros_like(x), x, 0.0, 2) == [3, 1]
