"""What a drive learns of how the world has changed."""

import pytest
import torch

from sextant.localization.appearance_change import AppearanceChange
from sextant.localization.constants import FEW
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.model import Residuals

ONE = torch.ones(1, dtype=torch.float64)


def descriptors(count=400, shift=2.0):
    rng = torch.Generator().manual_seed(0)
    seen = torch.randn(count, 8, generator=rng)
    return seen, torch.full((8,), shift)


def test_what_has_changed_everywhere_is_taken_away():
    places, shift = descriptors()
    change, mean = AppearanceChange.none(1, 8), places.mean(0)
    first = change.updated(places[:1] + shift, ONE).centred(places[:1] + shift, mean)[0]
    for place in places:
        change = change.updated(place[None] + shift, ONE)
    left = (change.centred(places[5:6] + shift, mean) - places[5]).abs().max()
    assert left < 2 * FEW / 400 * 1.2  # and not more than what is not believed yet
    assert (first - places[0] - shift).norm() < 0.5 * shift.norm()  # one image is not taken for the change


def test_who_stands_still_learns_nothing():
    places, _ = descriptors()
    change = AppearanceChange.none(1, 8).updated(places[:1], ONE)
    for _ in range(100):
        change = change.updated(places[1:2], 0 * ONE)
    assert torch.equal(change.mean[0], places[0].double())
    assert change.images == 1.0
    before_any = AppearanceChange.none(1, 8).updated(places[:1], 0 * ONE)
    assert torch.equal(before_any.centred(places[:1], places.mean(0)), places[:1])


def test_the_appearance_variance_is_half_as_large_again_as_the_mean_excess_of_the_best_image():
    change = AppearanceChange.none(1, 8)
    for least in (0.3, -0.5, 0.1):  # of one dimension, beyond the predicted variance of 0.2; less is none
        squared = torch.tensor([[9.0, 8 * (least + 0.2), 7.0]], dtype=torch.float64)
        variance = torch.full((1, 3), 0.2, dtype=torch.float64)
        change = change.updated(torch.zeros(1, 8), ONE).exceeded(Residuals(squared, variance), 8, ONE)
    found = change.likelihood(Likelihood(tempering=0.5, appearance_variance=0.01))
    assert float(found.appearance_variance) == pytest.approx(0.01 + 1.5 * (0.3 + 0.0 + 0.1) / 3)
    assert found.tempering == 0.5
