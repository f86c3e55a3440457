import math

import pytest
import torch
from scipy.stats import chisquare
from small_worlds import generator

from sextant.localization.appearance_proposal import AppearanceProposal


def scores(runs=2, images=12, seed=0):
    return 2 * torch.randn(runs, images, dtype=torch.float64, generator=generator(seed)) - 3000


def counts_of(rows, images):
    return torch.stack([torch.bincount(run, minlength=images) for run in rows])


@pytest.mark.slow
def test_rows_are_drawn_by_their_likelihood():
    log_likelihood = scores()
    rows = torch.cat([AppearanceProposal.of(log_likelihood).draw(1, generator(seed))[0] for seed in range(4000)], 1)
    for run in range(2):
        expected = 4000 * log_likelihood[run].softmax(0)
        assert chisquare(counts_of(rows, 12)[run].numpy(), expected.numpy()).pvalue > 1e-4


def test_many_draws_are_stratified():
    log_likelihood = scores()
    rows, told = AppearanceProposal.of(log_likelihood).draw(10_000, generator())
    expected = 10_000 * log_likelihood.softmax(1)
    assert bool(((counts_of(rows, 12) - expected).abs() <= 2).all())
    torch.testing.assert_close(told, log_likelihood.gather(1, rows))


def test_a_run_that_draws_less_draws_from_the_whole_of_its_distribution():
    log_likelihood = scores()
    rows, _ = AppearanceProposal.of(log_likelihood).draw(torch.tensor([10_000, 2000]), generator())
    assert rows.shape == (2, 10_000)
    own = torch.bincount(rows[1, :2000], minlength=12)
    assert bool(((own - 2000 * log_likelihood[1].softmax(0)).abs() <= 2).all())


def test_the_evidence_is_the_mean_likelihood():
    log_likelihood = scores()
    proposal = AppearanceProposal.of(log_likelihood)
    torch.testing.assert_close(proposal.log_evidence, log_likelihood.logsumexp(1) - math.log(12))
    torch.testing.assert_close(proposal.log_total, log_likelihood.logsumexp(1))


def test_the_best_images_alone():
    log_likelihood = scores()
    proposal = AppearanceProposal.of(log_likelihood, top=3)
    rows, told = proposal.draw(5000, generator())
    best = log_likelihood.topk(3, dim=1)
    for run in range(2):
        assert set(rows[run].tolist()) == set(best.indices[run].tolist())
    torch.testing.assert_close(told, log_likelihood.gather(1, rows))
    torch.testing.assert_close(proposal.log_total, best.values.logsumexp(1))
    torch.testing.assert_close(proposal.log_evidence, log_likelihood.logsumexp(1) - math.log(12))
    shares = (told - proposal.log_total[:, None]).exp()
    counts = counts_of(rows, 12).gather(1, rows).double()
    assert bool(((counts - 5000 * shares).abs() <= 2).all())


@pytest.mark.parametrize("nothing", [math.nan, -math.inf, math.inf])
@pytest.mark.parametrize("top", [None, 3])
def test_images_without_a_likelihood_are_never_drawn(nothing, top):
    log_likelihood = scores()
    log_likelihood[0, [0, 4, 11]] = nothing
    rows, _ = AppearanceProposal.of(log_likelihood, top).draw(5000, generator())
    assert not {0, 4, 11} & set(rows[0].tolist())


@pytest.mark.parametrize("nothing", [math.nan, -math.inf])
@pytest.mark.parametrize("top", [None, 3])
def test_a_run_that_no_image_explains_has_no_evidence(nothing, top):
    log_likelihood = scores()
    log_likelihood[0] = nothing
    proposal = AppearanceProposal.of(log_likelihood, top)
    rows, told = proposal.draw(10, generator())
    assert proposal.log_evidence[0] == -math.inf
    assert proposal.log_total[0] == -math.inf
    assert bool((told[0] == -math.inf).all())
    assert bool(((rows >= 0) & (rows < 12)).all())
    assert bool(proposal.log_evidence[1].isfinite())


def test_as_many_best_as_there_are_images_are_all():
    assert AppearanceProposal.of(scores(), top=12).rows is None
