"""How probable it is that a best match is right."""

import numpy as np
import pytest

from benchmarks.match_confidence_fit import fit_match_confidence
from sextant.chapters.places.match_confidence import MatchConfidence, deviations, verdict


def drawn(model, seed, count=20_000):
    rng = np.random.default_rng(seed)
    margin = rng.exponential(0.1, count)
    return margin, rng.random(count) < model.probability(margin)


def test_what_was_drawn_is_fitted_and_its_confidence_is_the_share_that_is_right():
    model = MatchConfidence(20.0, -2.0)
    found = fit_match_confidence([drawn(model, 0), drawn(model, 1, 5_000)])
    assert (found.slope, found.offset) == (pytest.approx(20, rel=0.1), pytest.approx(-2, abs=0.15))
    margin, right = drawn(model, 2)
    assert found.probability(margin).mean() == pytest.approx(right.mean(), abs=0.02)


def test_each_set_counts_the_same():
    few, many = (np.zeros(10), np.zeros(10, bool)), (np.zeros(1000), np.ones(1000, bool))
    assert fit_match_confidence([few, many]).probability(np.zeros(1))[0] == pytest.approx(0.5, abs=1e-3)


def test_a_wider_margin_is_surer_and_none_says_nothing():
    sure = MatchConfidence(24.0, -2.28).probability(np.array([0.0, 0.1, 1.0, np.nan]))
    assert sure[0] < sure[1] < sure[2]
    assert np.isnan(sure[3])


@pytest.mark.parametrize("margins", [[], [[0.1, 0.2], []], [[0.1, np.nan]]])
def test_sets_that_say_nothing_are_refused(margins):
    with pytest.raises(ValueError, match="at least one set of matches, each with finite margins"):
        fit_match_confidence([(np.array(each), np.ones(len(each), bool)) for each in margins])


@pytest.mark.parametrize("right", [[0, 0, 1, 1], [1, 1, 0, 0], [1, 1, 1, 1], [0, 0, 0, 0]])
def test_matches_that_a_margin_parts_are_refused(right):
    with pytest.raises(ValueError, match="add sets of images"):
        fit_match_confidence([(np.array([0.0, 0.1, 0.2, 0.3]), np.array(right, bool))])


def drawn_after_re_ranking(model, seed, count=20_000):
    rng = np.random.default_rng(seed)
    apart = deviations(rng.integers(0, 100, count), rng.integers(0, 60, count))
    return apart, rng.random(count) < model.probability(apart)


def test_what_was_drawn_after_re_ranking_is_fitted():
    model = MatchConfidence(slope=0.8, offset=-1.2)
    found = fit_match_confidence([drawn_after_re_ranking(model, 0), drawn_after_re_ranking(model, 1)])
    assert (found.slope, found.offset) == (pytest.approx(0.8, rel=0.1), pytest.approx(-1.2, abs=0.15))
    apart, right = drawn_after_re_ranking(model, 2)
    assert found.probability(apart).mean() == pytest.approx(right.mean(), abs=0.02)


def test_seven_inliers_are_no_evidence():
    few, none, alone = deviations([7, 0, 50], [0, 0, np.nan])
    assert few == none == 0
    assert np.isnan(alone)


@pytest.mark.parametrize(("found", "told"), [(None, None), (0.5, "in the map"), (0.49, "not in the map")])
def test_a_place_is_not_in_the_map_if_its_match_is_more_probably_wrong(found, told):
    assert verdict(found) == told
