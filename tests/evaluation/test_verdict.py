"""Verdicts are right as often as theory says, however the effect lies to the border."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from sextant.evaluation.verdict import Estimate, decide, further_seeds, together

CLAIMS, SEEDS = 1000, 8


def simulated(effect, expects="better", matters=0.0, seeds=SEEDS, parts=1, draw=0):
    """Share of 1,000 claims, each of the pairs of its seeds, with each verdict; effects in deviations of a pair."""
    pairs = effect + np.random.default_rng([draw, seeds]).standard_normal((CLAIMS, seeds))
    found = [Estimate.of_pairs(d.mean(), d.std(ddof=1), seeds) for d in pairs]
    verdicts = [decide(each, expects, matters, parts) for each in found]
    return {verdict: verdicts.count(verdict) / CLAIMS for verdict in ("holds", "fails", "undecided")}


def near(rate, sigmas=4):
    """A share of 1,000 draws that a chance of ``rate`` may give."""
    return pytest.approx(rate, abs=sigmas * math.sqrt(max(rate * (1 - rate), 1e-4) / CLAIMS))


def power(distance, seeds=SEEDS, tail=0.025):
    """Chance that a t interval clears a border at so many deviations of a pair."""
    return float(stats.nct.sf(stats.t.ppf(1 - tail, seeds - 1), seeds - 1, distance * math.sqrt(seeds)))


def power_of_equivalence(effect, matters, seeds=SEEDS, tail=0.025):
    """Chance that a t interval lies within (-m, m): the normal mean given the deviation, over its chi distribution."""
    quantile = stats.t.ppf(1 - tail, seeds - 1)

    def given(spread):
        room = matters - quantile * spread / math.sqrt(seeds)
        low, high = ((end - effect) * math.sqrt(seeds) for end in (-room, room))
        inside = stats.norm.cdf(high) - stats.norm.cdf(low)
        return max(0.0, inside) * stats.chi.pdf(spread * math.sqrt(seeds - 1), seeds - 1) * math.sqrt(seeds - 1)

    return float(integrate.quad(given, 0, matters * math.sqrt(seeds) / quantile)[0])


@pytest.mark.parametrize("matters", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("expects", ["better", "as_good", "same"])
def test_at_most_one_null_claim_in_twenty_is_called(expects, matters):
    border = matters if expects != "as_good" else -matters
    found = simulated(border, expects, matters)
    assert found["holds"] + found["fails"] <= 0.05 + 0.02  # three deviations of a share of 1,000


@pytest.mark.slow
def test_null_claims_of_no_effect_are_called_five_times_in_a_hundred_together():
    found = [simulated(0.0, draw=draw) for draw in range(5)]
    called = np.mean([each["holds"] + each["fails"] for each in found])
    assert called == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize("seeds", [8, 16])
@pytest.mark.parametrize("effect", [1.0, 2.0])
@pytest.mark.parametrize("matters", [0.0, 0.5])
def test_planted_effects_are_found_as_often_as_theory_says(effect, matters, seeds):
    found = simulated(effect, matters=matters, seeds=seeds)
    assert found["holds"] == near(power(effect - matters, seeds))
    assert found["fails"] <= 0.03


@pytest.mark.parametrize("matters", [1.0, 1.5, 2.0])
def test_a_true_equivalence_is_shown_as_often_as_theory_says(matters):
    assert simulated(0.0, "same", matters)["holds"] == near(power_of_equivalence(0.0, matters))
    assert simulated(0.0, "as_good", matters)["holds"] == near(power(matters))


@pytest.mark.parametrize("worlds", [3, 8])
def test_worlds_that_are_all_alike_do_not_exclude_that_others_differ(worlds):
    """One world in eight loses every robot, beyond the 10 points that matter: of 8 worlds, a third see none of them."""
    draws = 100.0 * (np.random.default_rng(worlds).random((CLAIMS, worlds)) < 0.125)
    found = [Estimate.of_pairs(d.mean(), d.std(ddof=1), worlds) for d in draws]
    told = [decide(replace(each, replicate="worlds", most=100.0), "better", 10.0) for each in found]
    assert sum(each.alike for each in found) > CLAIMS / 4
    assert told.count("fails") <= 0.025 * CLAIMS


def test_what_is_alike_in_every_replicate_is_bounded_by_how_many_there_are():
    alike = Estimate.of_pairs(mean=100.0, spread=0.0, seeds=10)
    found = replace(alike, most=100.0)
    low, high = found.interval()
    assert high == 100.0
    assert stats.binom.pmf(0, 10, (100 - low) / 200) == pytest.approx(0.025)  # as many may be worse by 200 points
    assert decide(found, "better", 10.0) == "holds"
    assert decide(replace(found, mean=0.0), "better", 10.0) == "undecided"
    more = further_seeds(replace(found, mean=0.0), "better", 10.0)
    assert decide(replace(found, mean=0.0, seeds=10 + more), "better", 10.0) == "fails"
    assert decide(replace(found, mean=0.0, seeds=9 + more), "better", 10.0) == "undecided"
    assert decide(alike, "better", 10.0) == "undecided"  # in a unit without limits
    assert further_seeds(alike, "better", 10.0) is None
    assert decide(Estimate(0.0, 0.0, math.inf, 0, counted=True), "as_good", 0.0) == "holds"


@pytest.mark.parametrize("matters", [1.0, 2.0])
def test_where_there_is_no_effect_a_difference_fails_as_often_as_its_absence_can_be_shown(matters):
    found = simulated(0.0, "better", matters)
    assert found["fails"] == near(power(matters))
    assert found["holds"] <= 0.03


def test_a_claim_of_many_parts_fails_by_chance_no_oftener_than_one_of_a_single_part():
    parts = [Estimate.of_pairs(0.5, 1.0, 8)] * 10
    rng = np.random.default_rng(3)
    failed = 0
    for _ in range(CLAIMS // 4):
        pairs = 0.5 + rng.standard_normal((len(parts), SEEDS))
        found = [Estimate.of_pairs(d.mean(), d.std(ddof=1), SEEDS) for d in pairs]
        failed += together([decide(each, "better", 0.5, len(parts)) for each in found]) == "fails"
    assert failed / (CLAIMS // 4) <= 0.025 + 0.035


def test_what_seeds_alone_made_has_to_be_exceeded():
    assert decide(Estimate.of_pairs(5.0, 1.0, 8), "better", 1.0) == "holds"
    assert decide(Estimate.of_pairs(5.0, 1.0, 8, floor=-4.9), "better", 1.0) == "undecided"
    assert decide(Estimate.of_pairs(0.1, 1.0, 8, floor=4.9), "better", 1.0) == "fails"


def test_few_seeds_decide_nothing_and_say_how_many_are_missing():
    sure = Estimate.of_pairs(50.0, 0.1, 3)
    assert decide(sure, "better", 1.0) == "undecided"
    assert further_seeds(sure, "better", 1.0) == 5
    assert further_seeds(Estimate.of_pairs(50.0, math.nan, 1), "better", 1.0) == 7


@pytest.mark.parametrize(
    ("mean", "expects", "matters"),
    [(1.5, "better", 1.0), (0.4, "better", 1.0), (0.2, "same", 1.0), (0.0, "same", 1.0)],
)
def test_the_seeds_asked_for_decide_four_times_in_five(mean, expects, matters):
    found = Estimate.of_pairs(mean, 2.0, 8)
    seeds = 8 + further_seeds(found, expects, matters)
    decided = simulated(mean / 2, expects, matters / 2, seeds)
    assert 0.72 <= decided["holds"] + decided["fails"] <= 0.9
    fewer = simulated(mean / 2, expects, matters / 2, seeds // 2)
    assert fewer["holds"] + fewer["fails"] < decided["holds"] + decided["fails"]


@pytest.mark.parametrize("parts", [1, 4, 20])
@pytest.mark.parametrize(("mean", "expects"), [(0.4, "better"), (-1.6, "as_good")])
def test_the_seeds_asked_for_decide_a_part_of_many_four_times_in_five(mean, expects, parts):
    found = Estimate.of_pairs(mean, 2.0, 8)
    seeds = 8 + further_seeds(found, expects, 1.0, parts)
    assert simulated(mean / 2, expects, 0.5, seeds, parts)["fails"] == pytest.approx(0.8, abs=0.06)


def test_holding_needs_no_more_seeds_for_being_one_of_many_parts():
    found = Estimate.of_pairs(1.5, 2.0, 8)
    assert further_seeds(found, "better", 1.0, 20) == further_seeds(found, "better", 1.0)
    assert further_seeds(Estimate.of_pairs(0.5, 2.0, 8), "better", 1.0, 20) > further_seeds(
        Estimate.of_pairs(0.5, 2.0, 8), "better", 1.0
    )


def test_an_effect_at_its_border_needs_more_seeds_than_anyone_has():
    assert further_seeds(Estimate.of_pairs(1.0, 2.0, 8), "better", 1.0) == math.inf
    assert further_seeds(Estimate.of_pairs(1.0, math.nan, 8), "better", 0.5) is None


@pytest.mark.parametrize(
    ("mean", "expects", "matters", "verdict"),
    [
        (0.0, "as_good", 0.0, "holds"),
        (-0.1, "as_good", 0.0, "fails"),
        (-5.9, "as_good", 10.0, "holds"),
        (12.0, "better", 10.0, "holds"),
        (9.0, "better", 10.0, "fails"),
        (0.0, "same", 0.0, "holds"),
    ],
)
def test_what_is_counted_needs_no_seeds(mean, expects, matters, verdict):
    assert decide(Estimate(mean, 0.0, math.inf, 0, counted=True), expects, matters) == verdict


@pytest.mark.parametrize(
    ("verdicts", "verdict"),
    [
        (["holds", "holds"], "holds"),
        (["holds", "undecided"], "undecided"),
        (["undecided", "fails"], "fails"),
        ([], "undecided"),
    ],
)
def test_a_claim_needs_all_its_parts(verdicts, verdict):
    assert together(verdicts) == verdict


def test_an_interval_of_which_only_the_ends_are_known_is_widened_for_several_parts():
    of_pairs = Estimate.of_pairs(-1.0, 1.0, SEEDS)
    known = Estimate(-1.0, math.nan, SEEDS - 1, SEEDS, known=of_pairs.interval())
    for tail in (0.025, 0.025 / 3):
        assert known.interval(tail) == pytest.approx(of_pairs.interval(tail))
    border = known.interval()[1] + 1e-6  # just below it with one part, not with three
    assert decide(known, "better", border) == "fails"
    assert decide(known, "better", border, parts=3) == "undecided"
