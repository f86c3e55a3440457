"""What the figures of place recognition show, read from their artists."""

import numpy as np
import pytest
from figures.written import legend_of, tick_labels
from matplotlib.colors import to_hex

from sextant.chapters.places.figures import (
    MOST_CELLS,
    RIGHT,
    UNKNOWN,
    WRONG,
    Retrieved,
    condition_confusion,
    invariance_curves,
    precision_recall_curves,
    retrieval_gallery,
    similarity_matrix,
)
from sextant.chapters.places.metrics import ConditionRecall, factor_recall, precision_recall
from sextant.evaluation.positives import Positives
from sextant.figures.style import save_figure

GOOD = precision_recall(np.array([0.9, 0.8, 0.7]), np.array([True, True, False]), 4)
BAD = precision_recall(np.array([0.9, 0.8, 0.7]), np.array([False, True, False]), 4)
IMAGE = np.zeros((4, 8, 1), np.uint8)


def test_curves_are_named_with_their_area_best_first():
    (axes,) = precision_recall_curves({"bad": BAD, "good": GOOD}, "pr_pm1f").axes
    assert legend_of(axes) == [f"good  {GOOD.auc:.3f}", f"bad  {BAD.auc:.3f}"]
    np.testing.assert_allclose(axes.lines[0].get_xydata(), 100 * np.column_stack([GOOD.recall, GOOD.precision]))
    assert axes.lines[1].get_xydata().tolist() == [[50, 100]]  # recall at full precision, of the good one alone
    assert axes.get_title() == "pr_pm1f"


def test_a_method_without_a_positive_comes_last():
    nothing = precision_recall(np.array([0.5]), np.array([False]), 0)
    (axes,) = precision_recall_curves({"nothing": nothing, "bad": BAD}).axes
    assert legend_of(axes)[1] == "nothing  nan"


def test_a_similarity_matrix_shows_band_and_verdicts(tmp_path):
    similarities = np.random.default_rng(0).normal(size=(6, 8)) + np.eye(6, 8)
    positives = Positives.from_lists([[0], [0, 1, 2], [], [3], [4], [5]], 8)
    matches = np.array([0, 2, 2, 7, 4, 5])
    figure = similarity_matrix(similarities, positives, matches, query="winter", reference="summer")
    axes = figure.axes[0]
    np.testing.assert_array_equal(axes.images[0].get_array(), similarities)
    first, last, wrong, right = axes.lines
    np.testing.assert_array_equal(first.get_xdata(), [-0.5, -0.5, np.nan, 2.5, 3.5, 4.5])
    np.testing.assert_array_equal(last.get_xdata(), [0.5, 2.5, np.nan, 3.5, 4.5, 5.5])
    assert wrong.get_xydata().tolist() == [[2, 2], [7, 3]]
    assert right.get_xydata().tolist() == [[0, 0], [2, 1], [4, 4], [5, 5]]
    assert legend_of(figure) == ["same place", "wrong: 2 of 6", "right: 4 of 6"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("summer frame", "winter frame")
    assert save_figure(figure, tmp_path, "similarity")[0].stat().st_size > 1000


def test_long_rides_are_reduced_without_losing_a_match():
    similarities = np.zeros((3 * MOST_CELLS + 5, 7))
    similarities[1234, 3] = 1
    axes = similarity_matrix(similarities).axes[0]
    shown = axes.images[0].get_array()
    assert shown.shape == (MOST_CELLS, 7)
    assert shown.max() == 1
    assert axes.images[0].get_extent() == [-0.5, 6.5, 3 * MOST_CELLS + 4.5, -0.5]


def test_the_gallery_frames_right_wrong_and_unknown():
    rows = [
        Retrieved(IMAGE, [IMAGE] * 3, [True, False, None], "frame 7", ["a", "b", "c"], truth=IMAGE),
        Retrieved(IMAGE, [IMAGE], [np.True_]),
    ]
    cells = retrieval_gallery(rows).axes
    assert len(cells) == 10
    assert [cell.get_title() for cell in cells[:5]] == ["frame 7", "✓ a", "✗ b", "c", "the place itself"]
    frames = [to_hex(cell.spines["left"].get_edgecolor()) for cell in (*cells[1:4], cells[6])]
    assert frames == [to_hex(colour) for colour in (RIGHT, WRONG, UNKNOWN, RIGHT)]
    assert [cell.axison for cell in cells] == [True] * 5 + [True, True] + [False] * 3
    assert not cells[0].spines["left"].get_visible()


def test_confusion_writes_per_cent_and_leaves_empty_cells_blank():
    recall = np.array([[1.0, 0.25, np.nan], [0.5, 0.75, np.nan], [np.nan] * 3])
    counts = np.zeros((3, 3), np.int64)
    (axes,) = condition_confusion(ConditionRecall(("noon", "night_rain", "fog"), recall, counts, counts)).axes
    assert [text.get_text() for text in axes.texts] == ["100", "25", "50", "75"]
    assert tick_labels(axes.yaxis) == tick_labels(axes.xaxis) == ["noon", "night rain", "fog"]
    assert axes.get_title() == "recall@1 (%)\nmean between two conditions 37.5"


def test_invariance_has_a_panel_a_factor_and_a_curve_a_method():
    curve = factor_recall(np.array([True, True, False, True]), np.array([0.0, 0.0, 1.0, 1.0]))
    figure = invariance_curves({"fog": {"a": curve, "b": curve}, "sun_elevation": {"b": curve}}, {"fog": 0.0})
    fog, sun = figure.axes
    assert (fog.get_xlabel(), sun.get_xlabel()) == ("fog", "sun elevation")
    assert fog.lines[0].get_xydata().tolist() == [[0, 100], [1, 50]]
    assert sun.lines[0].get_color() == fog.lines[1].get_color() != fog.lines[0].get_color()
    assert legend_of(figure) == ["a", "b", "in the reference images"]


def test_figures_of_nothing_are_refused():
    for draw in (precision_recall_curves, invariance_curves):
        with pytest.raises(ValueError, match="at least one"):
            draw({})
    with pytest.raises(ValueError, match="at least one query"):
        retrieval_gallery([])
    with pytest.raises(ValueError, match="a verdict"):
        retrieval_gallery([Retrieved(IMAGE, [IMAGE], [])])
    with pytest.raises(ValueError, match="need a match for each"):
        similarity_matrix(np.eye(3), None, np.arange(3))
    with pytest.raises(ValueError, match="need positives of 3 queries"):
        similarity_matrix(np.eye(3), Positives.from_lists([[0]], 3))
