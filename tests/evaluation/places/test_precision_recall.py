import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import average_precision_score, precision_recall_curve

from sextant.chapters.places.metrics import best_match_curve, precision_recall
from sextant.evaluation.positives import Positives
from sextant.evaluation.retrieval import RetrievalProtocol


def random_candidates(seed, count=40, levels=12, missed=5):
    """Similarities with ties, which candidates are right, and how many positives there are."""
    rng = np.random.default_rng(seed)
    similarities = rng.integers(0, levels, count) / levels
    right = rng.random(count) < 0.2 + 0.6 * similarities
    return similarities, right, int(right.sum()) + missed


@given(seed=st.integers(0, 999), missed=st.integers(0, 9))
def test_each_threshold_is_that_of_a_count(seed, missed):
    similarities, right, positives = random_candidates(seed, missed=missed)
    curve = precision_recall(similarities, right, positives)
    assert curve.thresholds[1:].tolist() == sorted(set(similarities), reverse=True)
    for precision, recall, threshold in zip(curve.precision, curve.recall, curve.thresholds, strict=True):
        accepted = similarities >= threshold
        assert recall == ((right & accepted).sum() / positives if positives else 0)
        assert precision == ((right & accepted).sum() / accepted.sum() if accepted.any() else 1)


@given(seed=st.integers(0, 999), missed=st.integers(0, 9))
def test_precision_is_scikit_learns_and_its_recall_flatters_by_what_was_missed(seed, missed):
    similarities, right, positives = random_candidates(seed, missed=missed)
    curve = precision_recall(similarities, right, positives)
    precision, recall, _ = precision_recall_curve(right, similarities)
    precision, recall = precision[::-1], recall[::-1]  # theirs rises with the threshold
    found = right.sum() / positives
    np.testing.assert_allclose(curve.precision, precision)
    np.testing.assert_allclose(curve.recall, recall * found)
    assert curve.average_precision == pytest.approx(average_precision_score(right, similarities) * found)


def test_a_case_by_hand():
    """Right, wrong, right and right, one positive missed."""
    curve = precision_recall(np.array([0.9, 0.8, 0.7, 0.6]), np.array([True, False, True, True]), 4)
    np.testing.assert_allclose(curve.precision, [1, 1, 1 / 2, 2 / 3, 3 / 4])
    np.testing.assert_allclose(curve.recall, [0, 1 / 4, 1 / 4, 1 / 2, 3 / 4])
    assert curve.average_precision == pytest.approx((1 + 2 / 3 + 3 / 4) / 4)
    assert curve.auc == pytest.approx((1 + (1 / 2 + 2 / 3) / 2 + (2 / 3 + 3 / 4) / 2) / 4)
    assert curve.recall_at_precision(1) == 0.25
    assert curve.recall_at_precision(0.7) == 0.75  # though precision was lower in between


def test_recall_at_a_precision_is_that_of_the_interpolated_curve():
    for seed in range(30):
        curve = precision_recall(*random_candidates(seed, levels=40))
        interpolated = np.maximum.accumulate(curve.precision[::-1])[::-1]
        for precision in (0.5, 0.9, 0.99, 1):
            assert curve.recall_at_precision(precision) == curve.recall[interpolated >= precision].max()


def test_99_of_100_is_a_precision_of_99_percent():
    similarities = np.append(np.full(99, 0.5), 0.5)
    right = np.append(np.full(99, True), False)
    assert precision_recall(similarities, right, 99).recall_at_precision(0.99) == 1


def test_no_match_at_full_precision_is_a_recall_of_zero():
    curve = precision_recall(np.array([0.9, 0.8]), np.array([False, True]), 1)
    assert curve.recall_at_precision(1) == 0


def test_matches_of_queries_without_a_positive_are_wrong_and_counted():
    positives = Positives.from_lists([[0], [], [1]], 2)
    neighbours, similarities = np.array([[0], [0], [0]]), np.array([[0.9], [0.8], [0.7]])
    curve = best_match_curve(neighbours, similarities, positives)
    np.testing.assert_allclose(curve.precision, [1, 1, 1 / 2, 1 / 3])
    np.testing.assert_allclose(curve.recall, [0, 1 / 2, 1 / 2, 1 / 2])
    assert (curve.positives, curve.unmatchable) == (2, 1)


def test_only_the_best_match_of_a_query_counts():
    positives = Positives.from_lists([[1]], 2)
    curve = best_match_curve(np.array([[0, 1]]), np.array([[0.9, 0.8]]), positives)
    assert curve.recall.max() == 0


def test_shuffled_similarities_have_the_precision_of_chance():
    rng = np.random.default_rng(0)
    right = rng.random(20_000) < 0.3
    curve = precision_recall(rng.random(20_000), right, int(right.sum()))
    assert curve.auc == pytest.approx(0.3, abs=0.02)
    assert curve.average_precision == pytest.approx(0.3, abs=0.02)


def test_without_a_positive_there_is_no_figure():
    curve = precision_recall(np.array([0.5]), np.array([False]), 0)
    figures = curve.named(RetrievalProtocol(1))
    assert set(figures) == {"pr_auc_pm1f", "average_precision_pm1f", "R@100P_pm1f", "R@99P_pm1f"}
    assert np.isnan(list(figures.values())).all()


def test_no_candidate_is_the_curve_where_nothing_is_accepted():
    curve = precision_recall(np.array([]), np.array([], bool), 3)
    assert (curve.precision.tolist(), curve.recall.tolist(), curve.auc) == ([1.0], [0.0], 0.0)


@pytest.mark.parametrize(
    ("similarities", "right", "positives", "complaint"),
    [
        ([np.nan], [True], 1, "not a number"),
        ([0.5], [True], 0, "only 0 positives"),
        ([0.5], [True, False], 1, "one similarity for each"),
    ],
)
def test_candidates_that_make_no_sense_are_refused(similarities, right, positives, complaint):
    with pytest.raises((ValueError, TypeError), match=f"{complaint}|Type-check"):
        precision_recall(np.array(similarities), np.array(right), positives)
    with pytest.raises(ValueError, match=r"must be in \(0, 1\]"):
        precision_recall(np.array([0.5]), np.array([True]), 1).recall_at_precision(0)
