import math

import pytest
import torch

from sextant.localization.innovation_test import ASKED, LOOKED_AT, InnovationTest, drawn_evenly, foreseen


def random_map(count, seed=0):
    return torch.randn(1, count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def seen_by(foresight, value, weight=1.0):
    return foresight.updated(torch.tensor([value]).double(), torch.tensor([weight]).double())


@pytest.mark.parametrize("count", [2, 7, 300, 3 * LOOKED_AT])
def test_of_places_that_have_nothing_to_do_with_an_image_it_is_half(count):
    assert foreseen(random_map(count), torch.arange(count)[None]).item() == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("count", [2, 300, 3 * LOOKED_AT])
def test_the_most_alike_is_1_and_the_least_alike_0(count):
    over_map = random_map(count)
    assert foreseen(over_map, over_map.argmax(1, keepdim=True)).item() == pytest.approx(1.0)
    assert foreseen(over_map, over_map.argmin(1, keepdim=True)).item() == pytest.approx(0.0)


def test_it_is_a_rank_so_that_no_scale_of_likelihoods_matters():
    over_map, rows = random_map(50), torch.tensor([[3, 4, 20]])
    assert foreseen(over_map, rows) == foreseen(1e6 * over_map - 1e9, rows) == foreseen(over_map.exp(), rows)


def test_places_that_look_alike_share_their_ranks():
    assert foreseen(torch.zeros(1, 9, dtype=torch.float64), torch.tensor([[0, 5]])) == 0.5


def test_of_values_that_are_no_numbers_it_says_what_it_can():
    over_map = torch.tensor([[0.0, torch.nan, 1.0, -torch.inf, 2.0]], dtype=torch.float64)
    assert foreseen(over_map, torch.tensor([[4]])) == 1.0
    assert foreseen(over_map, torch.tensor([[1, 3]])) == 0.0
    assert math.isnan(foreseen(torch.zeros(1, 1, dtype=torch.float64), torch.tensor([[0]])))
    unchanged = seen_by(InnovationTest.none(1), math.nan)
    assert (unchanged.mean, unchanged.images) == (0.5, 0.0)


def test_it_says_nothing_before_the_fifth_image_and_forgets_all_but_twenty():
    foresight = InnovationTest.none(1)
    for count in range(1, 5):
        foresight = seen_by(foresight, 0.1)
        assert math.isnan(foresight.told), count
        assert not foresight.failed
    assert seen_by(foresight, 0.1).failed
    for _ in range(200):
        foresight = seen_by(foresight, 0.9)
    assert foresight.told.item() == pytest.approx(0.9, abs=1e-3)
    assert foresight.images == 20


def test_two_halves_of_an_image_count_as_one():
    whole, halves = seen_by(seen_by(InnovationTest.none(1), 0.2), 0.8), InnovationTest.none(1)
    for value in (0.2, 0.2, 0.8, 0.8):
        halves = seen_by(halves, value, 0.5)
    assert halves.mean.item() == pytest.approx(whole.mean.item())
    assert halves.images == whole.images
    assert seen_by(whole, 0.0, 0.0).mean == whole.mean


def test_particles_are_asked_as_often_as_they_weigh():
    weights = torch.rand(1000, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    asked = drawn_evenly(weights[None])[0].bincount(minlength=1000)
    assert asked.sum() == ASKED
    assert ((asked - ASKED * weights / weights.sum()).abs() < 1).all()
