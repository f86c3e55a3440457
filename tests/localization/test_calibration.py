"""Likelihoods of descriptors fitted to images whose poses are known."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.evaluation.positives import Positives
from sextant.localization.calibration import appearance_noise, error_whitening, posterior, tempered
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import ExactGP


def draws(count, dimension, seed=0):
    generator = torch.Generator().manual_seed(seed)
    mix = torch.randn(dimension, dimension, generator=generator, dtype=torch.float64)
    return torch.randn(count, dimension, generator=generator, dtype=torch.float64) @ mix


# -- whitening ---------------------------------------------------------------------------------------------------------


def test_white_errors_stay_as_they_are():
    errors = torch.cat([torch.eye(6), -torch.eye(6)]).double() * 3.0
    torch.testing.assert_close(error_whitening(errors), torch.eye(6, dtype=torch.float64))


@given(st.integers(0, 10_000), st.integers(2, 8))
def test_the_shrunk_covariance_becomes_round_and_its_scale_stays(seed, dimension):
    errors, shrinkage = draws(200, dimension, seed), 0.1
    covariance = errors.mT @ errors / len(errors)
    mean = covariance.trace() / dimension
    shrunk = (1 - shrinkage) * covariance + shrinkage * mean * torch.eye(dimension, dtype=torch.float64)
    whitener = error_whitening(errors, shrinkage)
    torch.testing.assert_close(whitener @ shrunk @ whitener, mean * torch.eye(dimension, dtype=torch.float64))
    torch.testing.assert_close(whitener, whitener.mT)


def test_directions_that_err_more_count_less():
    errors = draws(500, 4) * torch.tensor([10.0, 1.0, 1.0, 1.0], dtype=torch.float64)
    values, vectors = torch.linalg.eigh(error_whitening(errors))
    _, main = torch.linalg.eigh(errors.mT @ errors)
    assert abs(float(vectors[:, 0] @ main[:, -1])) == pytest.approx(
        1, abs=1e-6
    )  # the least gain, on the worst direction
    assert values[0] < values[-1] / 2


def test_fewer_errors_than_dimensions_will_do():
    whitener = error_whitening(draws(3, 10))
    assert torch.linalg.eigvalsh(whitener).min() > 0


@pytest.mark.parametrize("errors", [torch.zeros(5, 3), torch.zeros(0, 3)])
def test_there_must_be_errors(errors):
    with pytest.raises(ValueError, match="no errors to whiten"):
        error_whitening(errors)


@pytest.mark.parametrize("shrinkage", [0.0, -1.0, 1.5])
def test_shrinkage_is_a_share(shrinkage):
    with pytest.raises(ValueError, match="shrinkage"):
        error_whitening(torch.eye(3), shrinkage)


# -- appearance noise --------------------------------------------------------------------------------------------------


def test_noise_is_what_the_model_does_not_expect():
    squared, variance = torch.tensor([8.0, 16.0]), torch.tensor([0.5, 1.5])
    assert appearance_noise(squared, variance, dimension=4) == pytest.approx(12 / 4 - 1)
    assert appearance_noise(squared, 10 * variance, dimension=4) == 0


@pytest.mark.parametrize("more", [0.0, 0.3, 1.0])
def test_noise_that_was_added_is_found(more):
    model = ExactGP().fit(smooth_map(400, 12), KERNEL)
    poses = poses_in_room(300, seed=5)
    seen = descriptors_at(poses, 12)
    seen = seen + more**0.5 * torch.randn(seen.shape, generator=torch.Generator().manual_seed(1))
    found = model.residuals(seen, poses[:, None])
    noise = appearance_noise(found.squared[:, 0], found.variance[:, 0], 12)
    assert noise == pytest.approx(more, abs=0.05 + 0.1 * more)


# -- tempering ---------------------------------------------------------------------------------------------------------


def matching(beta, queries=4000, images=6):
    """Scores with a softmax of ``beta`` times them that is exactly right: positives are drawn from it."""
    rng = np.random.default_rng(0)
    scores = rng.normal(scale=4.0, size=(queries, images))
    gumbel = rng.gumbel(size=scores.shape)
    right = (beta * scores + gumbel).argmax(axis=1)
    return torch.from_numpy(scores), Positives.from_lists([np.array([row]) for row in right], images)


@pytest.mark.parametrize("beta", [0.05, 0.3, 0.9])
def test_the_tempering_that_made_the_scores_is_found(beta):
    scores, positives = matching(beta)
    found = tempered(Likelihood(appearance_variance=0.2), scores, positives)
    assert found.tempering == pytest.approx(beta, rel=0.1, abs=0.013)  # three standard errors, 1 / sqrt(4000 * 16)
    assert found.appearance_variance == 0.2


def test_a_likelihood_is_never_made_sharper():
    scores, positives = matching(3.0)
    assert tempered(Likelihood(), scores, positives).tempering == 1


@pytest.mark.slow
@given(st.floats(0.02, 1.0))
def test_no_other_tempering_is_better(beta):
    scores, positives = matching(0.3, queries=300)
    best = tempered(Likelihood(), scores, positives).tempering
    assert posterior(scores, positives, best).nll <= posterior(scores, positives, beta).nll + 1e-6


def test_what_all_map_images_share_does_not_matter():
    scores, positives = matching(0.3, queries=300)
    shifted = scores + 1e6 * torch.randn(300, 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    one, other = (tempered(Likelihood(), each, positives).tempering for each in (scores, shifted))
    assert one == pytest.approx(other, rel=1e-3)


def test_without_a_positive_nothing_can_be_fitted():
    scores, _ = matching(0.3, queries=5)
    with pytest.raises(ValueError, match="positive"):
        tempered(Likelihood(), scores, Positives.from_lists([np.array([], np.int64)] * 5, 6))
