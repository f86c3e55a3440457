import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import softmax

from sextant.evaluation.positives import Positives
from sextant.evaluation.posterior import fit_temperature, place_posterior
from sextant.evaluation.retrieval import RetrievalProtocol


def drawn_from_the_posterior(temperature, queries=400, references=20, seed=0):
    """Similarities, and one positive for each query that is drawn from their softmax at ``temperature``."""
    rng = np.random.default_rng(seed)
    similarities = rng.normal(size=(queries, references))
    chance = softmax(similarities / temperature, axis=1)
    return similarities, Positives.from_lists([[rng.choice(references, p=row)] for row in chance], references)


@given(seed=st.integers(0, 999), temperature=st.floats(0.05, 50))
def test_it_is_the_sum_of_a_softmax_over_the_positives(seed, temperature):
    rng = np.random.default_rng(seed)
    similarities, mask = rng.normal(size=(6, 9)), rng.random((6, 9)) < 0.3
    mask[0, 0] = True
    right = (softmax(similarities / temperature, axis=1) * mask).sum(1)[mask.any(1)]
    result = place_posterior(similarities, Positives.from_mask(mask), temperature)
    assert result.nll == pytest.approx(-np.log(right).mean())
    assert result.unmatchable == (~mask.any(1)).sum()


@pytest.mark.parametrize("temperature", [0.1, 1.0, 7.0])
def test_the_temperature_that_drew_the_places_is_found_again(temperature):
    similarities, positives = drawn_from_the_posterior(temperature, queries=1500)
    assert fit_temperature(similarities, positives) == pytest.approx(temperature, rel=0.25)


def test_no_other_temperature_is_better():
    similarities, positives = drawn_from_the_posterior(0.7)
    fitted = fit_temperature(similarities, positives)
    best = place_posterior(similarities, positives, fitted).nll
    for factor in (0.1, 0.5, 0.98, 1.02, 2, 10):
        assert place_posterior(similarities, positives, factor * fitted).nll >= best


def test_the_fit_scales_with_the_similarities_and_ignores_their_offset():
    similarities, positives = drawn_from_the_posterior(0.7)
    fitted = fit_temperature(similarities, positives)
    assert fit_temperature(1000 * similarities + 5, positives) == pytest.approx(1000 * fitted, rel=1e-2)


def test_a_uniform_posterior_has_the_likelihood_of_chance():
    positives = Positives.from_lists([[0], [1, 2], []], 8)
    result = place_posterior(np.zeros((3, 8)), positives, 1.0)
    assert result.nll == pytest.approx(result.chance)
    assert result.chance == pytest.approx((np.log(8) + np.log(4)) / 2)


def test_shuffled_places_are_fitted_to_about_chance():
    similarities, positives = drawn_from_the_posterior(0.3, queries=2000)
    shuffled = similarities[np.random.default_rng(1).permutation(2000)]
    result = place_posterior(shuffled, positives, fit_temperature(shuffled, positives))
    assert result.nll == pytest.approx(result.chance, abs=0.02)


def test_sure_and_right_costs_nothing_and_sure_and_wrong_does_not_overflow():
    similarities = np.eye(4)
    right = Positives.from_lists([[i] for i in range(4)], 4)
    wrong = Positives.from_lists([[(i + 1) % 4] for i in range(4)], 4)
    assert place_posterior(similarities, right, 1e-4).nll == 0
    assert place_posterior(similarities, wrong, 1e-4).nll == pytest.approx(1e4)


def test_blocks_of_queries_change_nothing(monkeypatch):
    rng = np.random.default_rng(0)
    similarities, mask = rng.normal(size=(30, 9)), rng.random((30, 9)) < 0.1
    whole = place_posterior(similarities, Positives.from_mask(mask), 0.5)
    monkeypatch.setattr("sextant.evaluation.posterior.BLOCK", 20)
    assert place_posterior(similarities, Positives.from_mask(mask), 0.5).nll == pytest.approx(whole.nll, rel=1e-12)


def test_queries_without_a_positive_do_not_move_the_fit():
    similarities, positives = drawn_from_the_posterior(0.7, queries=50)
    more = Positives.from_lists([*[positives[i] for i in range(50)], []], 20)
    longer = np.concatenate([similarities, similarities[:1]])
    assert fit_temperature(longer, more) == pytest.approx(fit_temperature(similarities, positives), rel=1e-2)
    assert place_posterior(longer, more, 0.7).nll == place_posterior(similarities, positives, 0.7).nll


def test_figures_carry_the_protocol():
    similarities, positives = drawn_from_the_posterior(1.0, queries=5)
    named = place_posterior(similarities, positives, 1.0).named(RetrievalProtocol(5, "m"))
    assert set(named) == {"place_nll_5m", "place_nll_uniform_5m", "place_temperature_5m"}


def test_what_cannot_be_fitted_is_refused():
    similarities, positives = drawn_from_the_posterior(1.0, queries=5)
    with pytest.raises(ValueError, match="similarities that differ and a query with a positive"):
        fit_temperature(np.ones((5, 20)), positives)
    with pytest.raises(ValueError, match="similarities that differ and a query with a positive"):
        fit_temperature(similarities, Positives.from_lists([[]] * 5, 20))
    with pytest.raises(ValueError, match=r"need similarities \(5, 20\); got \(5, 19\)"):
        fit_temperature(similarities[:, :19], positives)
    with pytest.raises(ValueError, match="not finite"):
        place_posterior(np.full((5, 20), np.inf), positives, 1.0)
    for temperature in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="must be above 0"):
            place_posterior(similarities, positives, temperature)
    with pytest.raises(ValueError, match="needs a reference"):
        place_posterior(np.empty((1, 0)), Positives.from_lists([[]], 0), 1.0)
