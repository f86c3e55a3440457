import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from statsmodels.stats.proportion import proportion_confint

from sextant.chapters.places.metrics import condition_recall, factor_recall
from sextant.evaluation.positives import Positives


def images(seed, places=6, conditions=3):
    """Descriptors of places under conditions, some missing, and who shows the place of whom."""
    rng = np.random.default_rng(seed)
    place, condition = (values.ravel() for values in np.mgrid[:places, :conditions])
    kept = rng.random(len(place)) < 0.8
    place, condition = place[kept], condition[kept]
    descriptors = rng.normal(size=(places, 4))[place] + 0.8 * rng.normal(size=(len(place), 4))
    return descriptors.astype(np.float32), condition, np.abs(place[:, None] - place) <= 1


@given(seed=st.integers(0, 999))
def test_each_cell_is_that_of_a_loop(seed):
    descriptors, condition, mask = images(seed)
    result = condition_recall(descriptors, condition, Positives.from_mask(mask), ("a", "b", "c"))
    unit = descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)
    for row, column in np.ndindex(3, 3):
        queries, references = np.flatnonzero(condition == row), np.flatnonzero(condition == column)
        assert result.queries[row, column] == len(queries)
        others = [references[references != i] for i in queries]
        partners = [mask[i, each].any() for i, each in zip(queries, others, strict=True)]
        assert result.unmatchable[row, column] == len(queries) - sum(partners)
        if not len(queries) or not len(references):
            assert np.isnan(result.recall[row, column])
            continue
        hits = [
            bool(len(each)) and mask[i, each[np.argmax(unit[each] @ unit[i])]]
            for i, each in zip(queries, others, strict=True)
        ]
        assert result.recall[row, column] == pytest.approx(np.mean(hits))


def test_an_empty_condition_is_nan_and_left_out_of_the_mean():
    descriptors, condition, mask = images(1)
    positives = Positives.from_mask(mask)
    full = condition_recall(descriptors, condition, positives, ("a", "b", "c"))
    more = condition_recall(descriptors, condition, positives, ("a", "b", "c", "night"))
    assert np.isnan(more.recall[3]).all()
    assert np.isnan(more.recall[:, 3]).all()
    assert more.unmatchable[:, 3].tolist() == [*np.bincount(condition), 0]
    assert more.across == full.across
    assert np.isnan(condition_recall(descriptors, 0 * condition, positives, ("a",)).across)


def test_numbers_that_do_not_fit_are_refused():
    descriptors, condition, mask = images(1)
    positives = Positives.from_mask(mask)
    with pytest.raises(ValueError, match=r"positives of \d+ images among themselves"):
        condition_recall(descriptors, condition, Positives.from_mask(mask[:3]), ("a", "b", "c"))
    with pytest.raises(ValueError, match=r"conditions must be in \[0, 2\)"):
        condition_recall(descriptors, condition, positives, ("a", "b"))


@given(seed=st.integers(0, 999), level=st.floats(0.5, 0.99))
def test_recall_by_factor_is_grouped_and_has_statsmodels_wilson_interval(seed, level):
    rng = np.random.default_rng(seed)
    factor = rng.choice([-3.0, 0.0, 7.5], 50)
    hit = rng.random(50) < 0.5
    result = factor_recall(hit, factor, level)
    assert result.values.tolist() == sorted(set(factor))
    assert result.queries.sum() == 50
    for value, recall, low, high, queries in zip(
        result.values, result.recall, result.low, result.high, result.queries, strict=True
    ):
        chosen = hit[factor == value]
        assert recall == chosen.mean()
        expected = proportion_confint(chosen.sum(), queries, 1 - level, method="wilson")
        np.testing.assert_allclose((low, high), expected, atol=1e-9)


@pytest.mark.parametrize(("hit", "factor"), [([True], [np.nan]), ([True], [1.0, 2.0]), ([], [])])
def test_queries_without_a_factor_are_refused(hit, factor):
    with pytest.raises((ValueError, TypeError), match=r"as many hits as finite factors|Type-check"):
        factor_recall(np.array(hit, bool), np.array(factor, float))
