import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.stats.multitest import multipletests

from sextant.evaluation import holm

NAN = float("nan")
families = st.lists(st.floats(0, 1), min_size=1, max_size=8)


def test_holm_by_hand():
    # ascending .005, .01, .03, .04 times 4, 3, 2, 1 = .02, .03, .06, .04, and never below the one before
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_missing_tests_stay_missing_and_do_not_count():
    assert holm([NAN, 0.01, 0.04, NAN, 0.03, 0.005]) == pytest.approx([NAN, 0.03, 0.06, NAN, 0.06, 0.02], nan_ok=True)


@pytest.mark.parametrize("nothing", [[], [NAN], [NAN, NAN]])
def test_a_family_without_tests_stays_as_it_is(nothing):
    adjusted = holm(nothing)
    assert len(adjusted) == len(nothing)
    assert all(map(math.isnan, adjusted))


@settings(max_examples=10)
@given(families)
def test_adjusting_keeps_the_order_and_lies_between_none_and_bonferroni(p_values):
    adjusted = np.array(holm(p_values))
    assert np.all(adjusted >= p_values)
    assert np.all(adjusted <= np.minimum(1, len(p_values) * np.array(p_values)) + 1e-12)
    assert np.all(np.diff(adjusted[np.argsort(p_values)]) >= 0)


@settings(max_examples=10)
@given(families, st.randoms(use_true_random=False))
def test_the_order_of_the_tests_does_not_matter(p_values, random):
    order = random.sample(range(len(p_values)), len(p_values))
    shuffled = holm([p_values[i] for i in order])
    assert shuffled == list(np.array(holm(p_values))[order])


@pytest.mark.slow
def test_it_is_what_statsmodels_finds():
    p_values = [0.2, 0.001, 0.04, 0.001, 1.0, 0.0, 0.012, 0.04, 0.5]
    assert holm(p_values) == pytest.approx(multipletests(p_values, method="holm")[1])
