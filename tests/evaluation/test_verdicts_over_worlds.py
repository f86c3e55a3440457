"""The rule from images to verdict, simulated: frames of a drive are correlated, worlds have effects of their own.

A simulated claim is decided as a stored one is: from the differences of its runs image by image, by their mean, their
spread over seeds, and the interval for which images are a sample too. Nulls lie exactly at the border; planted effects
and equivalences are compared with the rates of theory.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, signal, stats

from sextant.evaluation.paired import BLOCKS, crossed_interval
from sextant.evaluation.verdict import Estimate, decide, detectable, power

FAST, FULL = 200, 1000
sizes = pytest.mark.parametrize("claims", [FAST, pytest.param(FULL, marks=pytest.mark.slow)])


def frames(rng, shape, correlation):
    """Values along a drive, of standard deviation 1, each correlated with its neighbour (an AR(1) process)."""
    noise = rng.standard_normal((*shape[:-1], shape[-1] + 200)) * math.sqrt(1 - correlation**2)
    return signal.lfilter([1], [1, -correlation], noise, axis=-1)[..., 200:]


def one_world(
    claims, effect, seeds=8, images=400, correlation=0.9, seed_spread=0.3, image_spread=1.0, world_spread=0.0
):
    """Differences of the runs of many claims, several seeds each on one drive's frames: (claims, seeds, images)."""
    rng = np.random.default_rng([claims, seeds, images])
    world = world_spread * rng.standard_normal((claims, 1, 1))
    shared = image_spread * frames(rng, (claims, 1, images), correlation)
    own = frames(rng, (claims, seeds, images), correlation)
    return effect + world + seed_spread * rng.standard_normal((claims, seeds, 1)) + shared + own


def several_worlds(claims, effect, worlds=8, seeds=2):
    """The mean difference within each world, over seeds and frames: (claims, worlds)."""
    found = one_world(claims * worlds, effect, seeds, images=100, world_spread=1.0)
    return found.mean(axis=(1, 2)).reshape(claims, worlds)


def over_images(claims, expects="better", matters=0.0):
    return [
        decide(
            Estimate.of_pairs(
                claim.mean(), claim.mean(1).std(ddof=1), len(claim), image_half=np.ptp(crossed_interval(claim)) / 2
            ),
            expects,
            matters,
        )
        for claim in claims
    ]


def over_worlds(claims, expects="better", matters=0.0):
    found = [Estimate.of_pairs(means.mean(), means.std(ddof=1), len(means)) for means in claims]
    return [decide(replace(each, replicate="worlds"), expects, matters) for each in found]


def shares(verdicts):
    return {verdict: verdicts.count(verdict) / len(verdicts) for verdict in ("holds", "fails", "undecided")}


def slack(rate, claims):
    """Three and a half standard deviations of a share of so many claims."""
    return 3.5 * math.sqrt(max(rate * (1 - rate), 0.01) / claims)


@sizes
@pytest.mark.parametrize("correlation", [0.0, 0.9])
@pytest.mark.parametrize(("expects", "border"), [("better", 0.5), ("as_good", -0.5), ("same", 0.5)])
def test_of_nulls_with_correlated_frames_at_most_one_in_twenty_is_called(claims, correlation, expects, border):
    found = shares(over_images(one_world(claims, border, correlation=correlation), expects, 0.5))
    assert found["holds"] + found["fails"] <= 0.05 + slack(0.05, claims) * 2 / 3.5


@pytest.mark.slow
@pytest.mark.parametrize("seed_spread", [0.0, 0.3, 1.0])
def test_of_thousands_of_nulls_no_more_are_called_however_little_seeds_make(seed_spread):
    """Without the part for neighbouring stretches 7.0, 5.7 and 4.1 of 100 are called."""
    claims = 4 * FULL
    found = shares(over_images(one_world(claims, 0.5, seed_spread=seed_spread), "better", 0.5))
    assert found["holds"] + found["fails"] <= 0.05 + slack(0.05, claims) / 3.5


def test_frames_that_counted_as_independent_would_call_too_many(monkeypatch):
    monkeypatch.setattr("sextant.evaluation.paired.BLOCKS", 10**6)
    found = shares(over_images(one_world(FAST, 0.0, seed_spread=0.0)))
    assert found["holds"] + found["fails"] > 0.15


@sizes
@pytest.mark.parametrize("seeds", [1, 2])
@pytest.mark.parametrize("expects", ["better", "same"])
def test_of_nulls_with_effects_of_their_worlds_at_most_one_in_twenty_is_called(claims, seeds, expects):
    found = shares(over_worlds(several_worlds(claims, 0.5, seeds=seeds), expects, 0.5))
    assert found["holds"] + found["fails"] <= 0.05 + slack(0.05, claims)


def test_seeds_in_one_world_say_nothing_of_others():
    """Eight seeds in one world call most nulls of all worlds, which eight worlds do not."""
    found = shares(over_images(one_world(FAST, 0.0, world_spread=1.0)))
    assert found["holds"] + found["fails"] > 0.5


def spread_of_a_world(seeds, images=100, correlation=0.9, world_spread=1.0):
    """Standard deviation of a world's mean difference, by theory."""
    lags = np.arange(1, images)
    of_frames = (1 + 2 * np.sum((1 - lags / images) * correlation**lags)) / images
    return math.sqrt(world_spread**2 + 0.3**2 / seeds + of_frames * (1 + 1 / seeds))


@sizes
@pytest.mark.parametrize("effect", [1.0, 2.0])
@pytest.mark.parametrize("worlds", [3, 8])
def test_planted_effects_are_found_over_worlds_at_the_rate_of_theory(claims, effect, worlds):
    found = shares(over_worlds(several_worlds(claims, effect, worlds), matters=0.5))
    expected = power(effect - 0.5, spread_of_a_world(2), worlds)
    assert found["holds"] == pytest.approx(expected, abs=slack(expected, claims))


@sizes
def test_an_effect_that_is_just_detectable_is_found_four_times_in_five(claims):
    effect = detectable(spread_of_a_world(2), 8)
    found = shares(over_worlds(several_worlds(claims, effect)))
    assert found["holds"] == pytest.approx(0.8, abs=slack(0.8, claims))


def power_of_equivalence(spread, matters, count):
    """Chance that a t interval lies within (-m, m) where nothing differs: over the distribution of the deviation."""
    quantile = stats.t.ppf(0.975, count - 1)

    def given(ratio):
        room = (matters - quantile * ratio * spread / math.sqrt(count)) * math.sqrt(count) / spread
        inside = max(0.0, 2 * stats.norm.cdf(room) - 1)
        return inside * stats.chi.pdf(ratio * math.sqrt(count - 1), count - 1) * math.sqrt(count - 1)

    return float(integrate.quad(given, 0, matters * math.sqrt(count) / quantile / spread)[0])


@sizes
@pytest.mark.parametrize("matters", [1.2, 2.0])
def test_a_true_equivalence_is_shown_over_worlds_at_the_rate_of_theory(claims, matters):
    expected = power_of_equivalence(spread_of_a_world(2), matters, 8)
    found = shares(over_worlds(several_worlds(claims, 0.0), "same", matters))
    assert found["holds"] == pytest.approx(expected, abs=slack(expected, claims))
    assert found["fails"] <= 0.05


@pytest.mark.parametrize("images", [2, 7, 8, 9, 100, 190, 10_000])
def test_stretches_hold_every_image_once_and_keep_the_mean(images):
    """At 2 images, at one fewer and one more than there are stretches, at numbers that they do not divide."""
    values = np.random.default_rng(images).standard_normal((8, images))
    low, high = crossed_interval(values)
    assert (low + high) / 2 == pytest.approx(values.mean())
    assert len(np.array_split(values, min(BLOCKS, images), axis=1)) == min(BLOCKS, images)
