"""How much one image counts, by how far apart it tells the places of the map."""

import math

import numpy as np
import pytest
import torch

from sextant.errors import ArgumentError
from sextant.localization import evidence_scale
from sextant.localization.evidence_scale import EvidenceScale, ScaledEvidence
from sextant.localization.observation.evidence import Evidence


def values(scale, count=1000, seed=0):
    return scale * torch.from_numpy(np.random.default_rng(seed).normal(size=(1, count)))


def scaled_by(over_map, weight=1.0, before=None, odds=20.0):
    before = EvidenceScale.none(1, odds) if before is None else before
    return before.updated(over_map, torch.tensor([weight]).double())


def test_the_most_alike_places_become_so_many_times_as_likely_as_the_least_alike():
    over_map = values(300.0)
    scale = scaled_by(over_map, odds=7.0)
    low, high = np.quantile(scale.tempering.item() * over_map.numpy(), (0.025, 0.975))
    assert math.exp(high - low) == pytest.approx(7.0)


def test_the_unit_of_what_is_told_does_not_matter():
    first, second = (scaled_by(values(unit)) for unit in (50.0, 5e6))
    torch.testing.assert_close(first.tempering * values(50.0), second.tempering * values(5e6))


def test_the_spread_is_a_mean_over_images_by_the_way_between_them():
    scale = EvidenceScale.none(1)
    weights, spreads = (1.0, 0.5, 0.0, 2.0), (10.0, 40.0, 1e9, 25.0)
    one = values(1.0)
    unit = scaled_by(one).spread
    for weight, spread in zip(weights, spreads, strict=True):
        scale = scaled_by(spread / unit * one, weight, scale)
    assert scale.spread.item() == pytest.approx(np.average(spreads, weights=weights))


@pytest.mark.parametrize("over_map", [torch.zeros(50), torch.full((50,), torch.nan), torch.tensor([3.0])])
def test_what_tells_nothing_of_the_map_leaves_the_evidence_as_it_is(over_map):
    assert scaled_by(over_map.double()[None]).tempering == 1.0


def test_it_never_makes_evidence_stronger_and_skips_what_is_not_finite():
    assert scaled_by(values(0.01)).tempering == 1.0
    with_holes = torch.cat([values(300.0), torch.full((1, 5), -torch.inf, dtype=torch.float64)], 1)
    assert scaled_by(with_holes).spread == scaled_by(values(300.0)).spread


def test_of_a_large_map_some_images_are_looked_at(monkeypatch):
    monkeypatch.setattr(evidence_scale, "LOOKED_AT", 100)
    found, whole = scaled_by(values(1.0, 250)), values(1.0, 250)[0]
    low, high = np.quantile(whole[::3].numpy(), (0.025, 0.975))
    assert found.spread.item() == pytest.approx(high - low)


@pytest.mark.parametrize("odds", [1.0, 0.5, -3.0, math.inf, math.nan])
def test_odds_that_are_none_are_refused(odds):
    with pytest.raises(ArgumentError, match="odds="):
        EvidenceScale.none(1, odds)


class Told(Evidence):
    def over_map(self):
        raise AssertionError("it is known")

    def log_likelihood(self, poses):
        return -poses[..., 0]


def test_evidence_is_tempered_at_poses_and_over_the_map_alike():
    scaled = ScaledEvidence(Told(), torch.tensor([[-2.0, -4.0]]), torch.tensor([0.25]))
    assert scaled.over_map().tolist() == [[-0.5, -1.0]]
    assert scaled.log_likelihood(torch.tensor([[[8.0, 0.0, 0.0]]])).tolist() == [[-2.0]]
