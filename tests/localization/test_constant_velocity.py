"""The pace of a drive, from ways between estimates that are sure or not."""

import numpy as np
import pytest
import torch

from sextant.localization.constant_velocity import MOST, ConstantVelocity
from sextant.localization.constants import FEW, UNKNOWN, WINDOW

HERE = torch.tensor([[3.0, -2.0, 0.7]], dtype=torch.float64)
ONE = torch.ones(1, dtype=torch.float64)


def driven(ways, weight=1.0, pace=None):
    pace = ConstantVelocity.none(1) if pace is None else pace
    for way in ways:
        ahead = torch.tensor([way * np.cos(0.7), way * np.sin(0.7), 0.0], dtype=torch.float64)
        pace = pace.updated(HERE, HERE + ahead, weight * ONE, ONE)
    return pace


def test_it_is_the_way_along_the_heading_once_there_are_enough():
    assert driven([2.0] * (FEW - 1)).along(1.0).isnan()
    assert driven([2.0] * FEW).along(1.0).item() == pytest.approx(2.0)
    assert driven([-2.0] * FEW).along(1.0).item() == pytest.approx(-2.0)  # backwards


def test_a_way_of_several_steps_is_shared_out():
    pace, there = (
        ConstantVelocity.none(1),
        HERE + torch.tensor([6 * np.cos(0.7), 6 * np.sin(0.7), 0.0], dtype=torch.float64),
    )
    for _ in range(FEW):
        pace = pace.updated(HERE, there, ONE, steps=3 * ONE)
    assert pace.along(1.0).item() == pytest.approx(2.0)


def test_ways_that_lead_anywhere_are_no_pace_and_where_few_do_it_stays():
    anywhere = np.random.default_rng(0).uniform(-100, 100, 30)
    assert driven(anywhere).along(1.0).isnan()
    assert driven([2.0, 2.0, 70.0, 2.0, -40.0, 2.0, 2.0, 2.0]).along(1.0).item() == pytest.approx(2.0)


def test_a_fast_robot_may_vary_by_as_much_as_it_moves():
    ways = [10.0, 16.0] * 5
    assert driven(ways).along(1.0).item() == pytest.approx(10.0)
    assert driven([0.0, 6.0] * 5).along(1.0).isnan()  # its pace is 0 or 6
    assert driven([0.0, 6.0] * 5).along(2.0).isfinite()  # which is little in a map with an image every 2 m


def test_a_robot_departs_less_from_a_pace_the_more_its_ways_agree():
    assert ConstantVelocity.none(1).departure(1.0).item() == driven([2.0] * (FEW - 1)).departure(1.0).item() == 1.0
    found = [driven([2.0, 2.0 + apart] * 5).departure(1.0).item() for apart in (0.0, 1.0, 3.0, 5.9)]
    assert found == sorted(found)
    assert found[0] == pytest.approx((1 / (1 + WINDOW)) ** 0.5)
    assert found[-1] == 1.0
    assert driven([2.0] * FEW).departure(1.0).item() > found[0]  # fewer displacements say less
    assert driven([2.0, 60.0] * 5).departure(1.0).item() == 1.0  # no pace


def test_it_outlasts_estimates_that_are_not_sure_and_follows_those_that_are():
    before = driven([2.0] * 10)
    assert driven([0.0] * 20, 0.1, before).along(1.0).item() == pytest.approx(2.0)  # a tunnel
    assert driven([5.0] * 10, 1.0, before).along(1.0).item() == pytest.approx(5.0)
    assert driven([0.0] * MOST, 0.1, before).along(1.0).item() == pytest.approx(0.0)  # and in the end those too


def test_the_departure_is_that_of_many_displacements_with_a_normal_error():
    """In units of how far a robot moves without a pace, in the limit of many displacements."""
    ways = 20 + 0.8 * UNKNOWN * np.random.default_rng(0).standard_normal(MOST)
    pace = driven(ways)
    many = ConstantVelocity(pace.ways, torch.full_like(pace.weights, 1e6))
    assert many.departure(1.0).item() == pytest.approx(0.8, rel=0.25)


@pytest.mark.parametrize("weight", [0.0, float("nan")])
def test_what_is_off_the_map_or_no_number_teaches_nothing(weight):
    for pace in (driven([2.0] * 10, weight), driven([float("nan"), float("inf")] * 10)):
        assert not pace.weights.any()
