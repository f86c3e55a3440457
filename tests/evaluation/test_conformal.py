"""The finite-sample guarantee by simulation, and the rank by counting."""

from fractions import Fraction
from math import ceil

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.evaluation.conformal import (
    conformal_quantile,
    conformal_rank,
    coverage,
    coverage_curve,
)


@given(st.integers(1, 3000), st.integers(1, 999))
def test_the_rank_is_that_of_exact_arithmetic(count, thousandths):
    exact = ceil((count + 1) * Fraction(thousandths, 1000))
    assert conformal_rank(count, thousandths / 1000) == exact


@given(st.integers(1, 200), st.integers(1, 12), st.integers(1, 99))
def test_the_rank_with_crops_is_that_of_exact_arithmetic(panoramas, crops, percent):
    exact = ceil(crops * (panoramas + 1) * Fraction(percent, 100))
    assert conformal_rank(panoramas * crops, percent / 100, crops) == exact


@pytest.mark.parametrize("level", [0.0, 1.0, -0.1, 95.0])
def test_levels_are_probabilities(level):
    with pytest.raises(ValueError, match=r"\(0, 1\)"):
        conformal_rank(10, level)


def test_crops_must_be_spread_evenly():
    with pytest.raises(ValueError, match="10 scores cannot be split into panoramas with 3 each"):
        conformal_rank(10, 0.5, 3)


@pytest.mark.parametrize(("count", "level"), [(19, 0.9), (50, 0.68), (50, 0.95), (7, 0.5)])
def test_coverage_is_at_least_the_level_and_at_most_one_score_more(count, level):
    """Over 4000 validation sets; the chance that a new score is in, given the set, is known exactly for uniforms."""
    scores = torch.from_numpy(np.random.default_rng(count).uniform(size=(count, 4000)))
    quantile = conformal_quantile(scores, level)  # the columns are the sets: a uniform score is below q with chance q
    mean, error = quantile.mean().item(), quantile.std().item() / 4000**0.5
    assert mean >= level - 4 * error
    assert mean <= level + 1 / (count + 1) + 4 * error
    assert mean == pytest.approx(conformal_rank(count, level) / (count + 1), abs=4 * error)


def test_the_plain_sample_quantile_would_cover_less():
    scores = np.random.default_rng(0).uniform(size=(19, 4000))
    assert np.quantile(scores, 0.9, axis=0, method="inverted_cdf").mean() == pytest.approx(0.9, abs=0.01)
    assert np.quantile(scores, 0.9, axis=0).mean() < 0.89
    assert conformal_quantile(torch.from_numpy(scores), 0.95).mean().item() == pytest.approx(0.95, abs=0.005)
    assert np.quantile(scores, 0.95, axis=0).mean() < 0.91


def panorama_scores(seed, panoramas, crops, share=0.9):
    """Uniform scores of 3000 validation sets whose crops mostly share the score of their panorama."""
    g = np.random.default_rng(seed)
    shape = (panoramas, 1, 3000), (panoramas, crops, 3000)
    normal = np.sqrt(share) * g.normal(size=shape[0]) + np.sqrt(1 - share) * g.normal(size=shape[1])
    return torch.special.ndtr(torch.from_numpy(normal.reshape(panoramas * crops, 3000)))


@pytest.mark.parametrize("level", [0.5, 0.68, 0.9])
def test_crops_of_a_panorama_are_no_independent_scores(level):
    """A crop of a new panorama is covered if panoramas count, and too rarely if each crop counts."""
    scores = panorama_scores(0, panoramas=12, crops=8)
    by_panorama = conformal_quantile(scores, level, per_panorama=8)
    error = by_panorama.std().item() / 3000**0.5
    assert by_panorama.mean().item() >= level - 4 * error
    if level == 0.9:
        assert conformal_quantile(scores, level).mean().item() < level - 4 * error


def test_single_crops_of_panoramas_are_plain_conformal():
    scores = torch.rand(40, 3, generator=torch.Generator().manual_seed(0))
    for level in (0.5, 0.9, 0.95):
        assert torch.equal(conformal_quantile(scores, level, 1), conformal_quantile(scores, level))
        assert (conformal_quantile(scores, level, 8) >= conformal_quantile(scores, level)).all()


def test_a_level_that_too_few_scores_cannot_support_is_infinite():
    scores = torch.arange(18.0)[:, None].expand(18, 4)
    assert conformal_quantile(scores, 0.95).isinf().all()
    assert conformal_quantile(torch.arange(19.0), 0.95) == 18
    assert conformal_quantile(torch.arange(8 * 18.0), 0.95, per_panorama=8).isinf()


def test_scores_come_in_any_order_and_a_missing_one_counts_as_the_worst():
    shuffled = torch.tensor([3.0, 1.0, torch.nan, 2.0])
    assert conformal_quantile(shuffled, 0.6) == 3
    assert conformal_quantile(shuffled, 0.7).isinf()
    assert coverage(torch.tensor([1.0, torch.nan]), torch.tensor(torch.inf)) == 0.5


def test_coverage_by_hand():
    quantile = torch.tensor([1.0, 2.0])
    assert coverage(torch.tensor([[0.5, 3.0], [1.0, 1.0]]), quantile).tolist() == [1.0, 0.5]


def test_the_curve_of_exchangeable_scores_follows_the_levels():
    g = torch.Generator().manual_seed(1)
    validation, test = torch.rand(1999, 4, generator=g), torch.rand(4000, 4, generator=g)
    panoramas = np.arange(4000) // 8
    curve = coverage_curve(validation, test, panoramas, resamples=200)
    assert curve.coverage.shape == curve.low.shape == (19, 4)
    np.testing.assert_allclose(curve.coverage, np.repeat(curve.levels[:, None], 4, 1), atol=0.04)
    assert (curve.low <= curve.coverage).all()
    assert (curve.high >= curve.coverage).all()
    assert ((curve.high - curve.low) < 0.05).all()
    np.testing.assert_allclose(curve.coverage[9], coverage(test, conformal_quantile(validation, 0.5)).numpy())
    np.testing.assert_allclose(curve.multipliers[9], conformal_quantile(validation, 0.5).numpy())


def test_the_band_is_wider_when_whole_panoramas_are_held_or_missed():
    validation = torch.rand(999, 1, generator=torch.Generator().manual_seed(2))
    test = torch.rand(50, 1, generator=torch.Generator().manual_seed(3)).repeat_interleave(8, 0)
    by_panorama, by_crop = (
        coverage_curve(validation, test, which, (0.5,), resamples=500)
        for which in (np.arange(400) // 8, np.arange(400))
    )
    assert (by_panorama.high - by_panorama.low).item() > 2 * (by_crop.high - by_crop.low).item()


def test_better_than_the_constant_scale():
    """An expected error that follows the error's size gives shorter intervals at equal coverage."""
    g = np.random.default_rng(4)
    spread = torch.from_numpy(g.choice([0.2, 3.0], size=(6000, 1), p=[0.8, 0.2]))
    error = (spread * torch.from_numpy(g.normal(size=(6000, 1)))).abs()
    typical = {}
    for name, scale in (("adaptive", spread), ("constant", torch.ones_like(spread))):
        quantile = conformal_quantile((error / scale)[:3000], 0.9)
        assert coverage((error / scale)[3000:], quantile).item() == pytest.approx(0.9, abs=0.025)
        typical[name] = (scale * quantile).mean().item()
    assert typical["adaptive"] < 0.9 * typical["constant"]
