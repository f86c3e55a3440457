"""One battery for all resamplers: unbiased, in the known order of variances, right at the edges."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare
from small_worlds import generator

from sextant.localization.resampling import (
    MultinomialResampling,
    ResidualResampling,
    StratifiedResampling,
    SystematicResampling,
)

ALL = [SystematicResampling(), StratifiedResampling(), ResidualResampling(), MultinomialResampling()]
weight_lists = st.lists(st.floats(-30, 3), min_size=1, max_size=25)


@pytest.fixture(params=ALL, ids=["systematic", "stratified", "residual", "multinomial"])
def resampling(request):
    return request.param


def offspring(resampling, log_weights, count, runs=1, seed=0):
    """How often each particle was drawn in each of many runs with the same weights."""
    ancestors = resampling.resample(log_weights.expand(runs, -1), count, generator(seed))
    counts = torch.zeros(runs, log_weights.shape[1], dtype=torch.float64)
    return counts.scatter_add_(1, ancestors, torch.ones_like(ancestors, dtype=torch.float64))


WEIGHTS = torch.tensor([[0.02, 0.3, 0.005, 0.175, 0.11, 0.09, 0.25, 0.05]], dtype=torch.float64).log()


def test_offspring_are_unbiased(resampling):
    count, runs = 5, 8000
    means = offspring(resampling, WEIGHTS, count, runs).mean(0)
    error = math.sqrt(count) * WEIGHTS[0].exp().sqrt() / math.sqrt(runs)  # no larger than that of multinomial draws
    assert bool(((means - count * WEIGHTS[0].exp()).abs() < 5 * error).all())


def test_one_draw_has_the_weights_for_its_distribution(resampling):
    counts = offspring(resampling, WEIGHTS, 1, runs=8000, seed=3).sum(0)
    assert chisquare(counts.numpy(), (8000 * WEIGHTS[0].exp()).numpy()).pvalue > 1e-4


def test_the_variances_stand_in_their_order():
    """Total variance of offspring over random weights: systematic <= stratified <= multinomial; residual as well."""
    totals = []
    log_weights = torch.randn(20, 40, dtype=torch.float64, generator=generator(5))
    for resampling in ALL:
        variances = [offspring(resampling, row[None], 40, runs=1000, seed=9).var(0).sum() for row in log_weights]
        totals.append(float(torch.stack(variances).mean()))
    systematic, stratified, residual, multinomial = totals
    assert systematic < stratified < multinomial
    assert residual < multinomial


@given(weight_lists, st.integers(1, 60), st.integers(0, 100))
def test_systematic_offspring_are_one_of_two_whole_numbers(log_weights, count, seed):
    log_weights = torch.tensor([log_weights], dtype=torch.float64)
    counts = offspring(SystematicResampling(), log_weights, count, seed=seed)
    expected = count * log_weights.softmax(1)
    assert bool(((counts - expected).abs() < 1 + 1e-9).all())


@given(weight_lists, st.integers(1, 60), st.integers(0, 100))
def test_residual_offspring_are_never_below_their_whole_part(log_weights, count, seed):
    log_weights = torch.tensor([log_weights], dtype=torch.float64)
    counts = offspring(ResidualResampling(), log_weights, count, seed=seed)
    assert bool((counts >= (count * log_weights.softmax(1) - 1e-9).floor()).all())


@given(st.integers(2, 30), st.integers(0, 100))
def test_equal_weights_keep_every_particle_once(particles, seed):
    for resampling in (SystematicResampling(), ResidualResampling(), StratifiedResampling()):
        counts = offspring(resampling, torch.zeros(1, particles).double(), particles, seed=seed)
        if isinstance(resampling, StratifiedResampling):
            assert bool((counts <= 2).all())
        else:
            assert bool((counts == 1).all())


def test_the_order_of_the_particles_does_not_matter_on_average(resampling):
    order = torch.tensor([3, 1, 7, 0, 6, 2, 5, 4])
    means = offspring(resampling, WEIGHTS, 6, runs=6000).mean(0)
    permuted = offspring(resampling, WEIGHTS[:, order], 6, runs=6000, seed=1).mean(0)
    assert float((means[order] - permuted).abs().max()) < 0.08


@given(
    st.lists(st.sampled_from([0.0, -1.0, -745.0, -math.inf]), min_size=1, max_size=12).filter(
        lambda values: max(values) > -math.inf
    ),
    st.integers(1, 40),
    st.floats(-1e5, 1e5),
)
def test_particles_without_weight_have_no_offspring(log_weights, count, constant):
    log_weights = torch.tensor([log_weights], dtype=torch.float64) + constant
    for resampling in ALL:
        counts = offspring(resampling, log_weights, count)
        assert counts.sum() == count
        assert bool((counts[log_weights == -math.inf] == 0).all())


def test_one_heavy_particle_takes_all(resampling):
    log_weights = torch.full((1, 50), -math.inf, dtype=torch.float64)
    log_weights[0, 17] = -900.0
    assert offspring(resampling, log_weights, 200)[0, 17] == 200


def test_runs_are_drawn_apart_and_with_their_own_counts(resampling):
    log_weights = torch.full((3, 4), -math.inf, dtype=torch.float64)
    log_weights[0, 0] = log_weights[1, 3] = 0.0
    log_weights[2] = 0.0
    ancestors = resampling.resample(log_weights, torch.tensor([2, 8, 4]), generator())
    assert ancestors.shape == (3, 8)
    assert ancestors[0, :2].tolist() == [0, 0]
    assert ancestors[1].tolist() == [3] * 8
    if isinstance(resampling, (SystematicResampling, ResidualResampling)):
        assert sorted(ancestors[2, :4].tolist()) == [0, 1, 2, 3]
    assert bool(((ancestors >= 0) & (ancestors < 4)).all())


def test_a_count_for_each_run_is_unbiased_too(resampling):
    log_weights = WEIGHTS.expand(4000, -1)
    counts = torch.tensor([3, 11]).repeat(2000)
    ancestors = resampling.resample(log_weights, counts, generator())
    for count in (3, 11):
        drawn = ancestors[counts == count][:, :count].flatten()
        share = torch.bincount(drawn, minlength=8) / len(drawn)
        assert float((share - WEIGHTS[0].exp()).abs().max()) < 0.03


@pytest.mark.parametrize("value", [-math.inf, math.nan, math.inf])
def test_weights_that_are_none_are_refused(resampling, value):
    log_weights = torch.zeros(2, 3, dtype=torch.float64)
    log_weights[1] = value
    with pytest.raises(ValueError, match="no weight above zero"):
        resampling.resample(log_weights, 3, generator())


def test_nothing_to_draw_is_refused(resampling):
    with pytest.raises(ValueError, match="at least one particle"):
        resampling.resample(torch.zeros(1, 3).double(), 0, generator())


def test_the_same_generator_gives_the_same_ancestors(resampling):
    log_weights = torch.randn(2, 30, dtype=torch.float64, generator=generator())
    first, again, other = (resampling.resample(log_weights, 30, generator(seed)) for seed in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
