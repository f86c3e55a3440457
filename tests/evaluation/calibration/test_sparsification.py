"""Curves by taking images away one by one; areas at the orders whose value is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from scipy import stats

from sextant.chapters.calibration.metrics.sparsification import sparsification

ERRORS = np.random.default_rng(0).exponential(size=300)


def curve_by_removal(errors, uncertainty):
    left = list(range(len(errors)))
    means = []
    while left:
        means.append(np.mean([errors[i] for i in left]))
        left.remove(max(left, key=lambda i: uncertainty[i]))
    return np.array(means) / np.mean(errors)


def test_curves_are_those_of_taking_the_most_uncertain_image_away():
    errors, uncertainty = ERRORS[:40], np.random.default_rng(1).permutation(40).astype(float)
    found = sparsification(errors, uncertainty)
    np.testing.assert_allclose(found.curve, curve_by_removal(errors, uncertainty))
    np.testing.assert_allclose(found.oracle, curve_by_removal(errors, errors))
    np.testing.assert_allclose(found.removed, np.arange(40) / 40)
    assert found.ause == pytest.approx(np.mean(found.curve - found.oracle))
    assert found.spearman == pytest.approx(stats.pearsonr(stats.rankdata(errors), uncertainty)[0])


def test_the_oracle_has_no_area_and_a_constant_that_of_random_order():
    perfect = sparsification(ERRORS, np.exp(3 * ERRORS))
    assert perfect.ause == pytest.approx(0, abs=1e-12)
    assert perfect.relative == pytest.approx(0, abs=1e-12)
    assert perfect.spearman == pytest.approx(1)
    blind = sparsification(ERRORS, np.full(300, 0.3))
    np.testing.assert_allclose(blind.curve, 1)
    assert blind.relative == pytest.approx(1)
    assert np.isnan(blind.spearman)


def test_random_order_averages_one_and_the_reverse_is_worse():
    g = np.random.default_rng(2)
    areas = [sparsification(ERRORS, g.uniform(size=300)).relative for _ in range(200)]
    assert np.mean(areas) == pytest.approx(1, abs=4 * np.std(areas) / 200**0.5)
    worst = sparsification(ERRORS, -ERRORS)
    assert worst.relative > 1.5
    assert worst.spearman == pytest.approx(-1)


@given(st.lists(st.tuples(st.floats(0, 100), st.integers(0, 5)), min_size=2, max_size=30), st.randoms())
def test_no_order_lies_below_the_oracle_and_the_order_of_the_input_does_not_matter(rows, random):
    if not any(error > 1e-3 for error, _ in rows):
        rows.append((1.0, 0))
    shuffled = random.sample(rows, len(rows))
    first, second = (
        sparsification(np.array([e for e, _ in r]), np.array([float(u) for _, u in r])) for r in (rows, shuffled)
    )
    assert (first.curve >= first.oracle - 1e-9).all()
    assert first.curve[0] == pytest.approx(1)
    np.testing.assert_allclose(first.curve, second.curve, rtol=1e-9, atol=1e-12)


def test_only_the_order_of_the_uncertainty_and_the_ratio_of_errors_matter():
    uncertainty = ERRORS * np.random.default_rng(3).lognormal(size=300)
    first, second = sparsification(ERRORS, uncertainty), sparsification(7 * ERRORS, np.log(uncertainty))
    assert 0 < first.relative < 1
    np.testing.assert_allclose(first.curve, second.curve)
    assert first.ause == pytest.approx(second.ause)


def test_equal_errors_have_no_order():
    assert np.isnan(sparsification(np.ones(5), np.arange(5.0)).relative)


@pytest.mark.parametrize(
    ("errors", "uncertainty"),
    [([], []), ([1.0, 2.0], [1.0]), ([1.0, np.inf], [1.0, 2.0]), ([1.0, -1.0], [1.0, 2.0]), ([0.0, 0.0], [1.0, 2.0]),
     ([1.0, 2.0], [np.nan, 2.0])],
)  # fmt: skip
def test_what_has_no_curve_is_refused(errors, uncertainty):
    with pytest.raises((ValueError, TypeCheckError), match="uncertaint"):
        sparsification(np.array(errors), np.array(uncertainty))
