"""Legends have the entries of what is drawn, and none of what was not given.

Boundaries: nothing, some and all of what may be left out: true values, published values, noise floors, seeds, values of
the reference, intervals that contain zero, places with a match, images that are lost.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from sextant.chapters.classification.figures import DifferenceBar, corruption_difference
from sextant.chapters.localization.written_poses import draw_trajectory
from sextant.chapters.places.figures import invariance_curves, similarity_matrix
from sextant.chapters.places.metrics import factor_recall
from sextant.evaluation.positives import Positives
from sextant.figures.effects import ForestRow, contrast_forest
from sextant.figures.searches import TrialPoint, search_history

NAN = float("nan")
MEAN, FLOOR, PUBLISHED = "mean over seeds, 95 % interval", "one pair of runs, seeds alone", "published, one run each"
ALL, GIVEN, BEST, NONE = "mean over all seeds", "mean over its seeds so far", "best so far", "no result"
BETTER, WORSE, PALE, SEEDS = "better on", "worse on", "pale: interval contains 0", "seeds alone"


def entries(figure):
    legends = [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def forest(*rows):
    return contrast_forest([("", [ForestRow("fog", 1, 0, 2, *row) for row in rows])], "points")


def history(*trials):
    return search_history([TrialPoint(k, *trial) for k, trial in enumerate(trials)], "accuracy", maximize=True)


def difference(*bars):
    return corruption_difference([DifferenceBar(str(k), *bar) for k, bar in enumerate(bars)])


def matrix(positives=None, matches=None):
    return similarity_matrix(np.eye(2), positives and Positives.from_lists(positives, 2), matches)


def invariance(reference):
    curve = factor_recall(np.array([True, True, True, False]), np.array([0.0, 0.0, 0.5, 0.5]))
    return invariance_curves({"fog": {"pixels": curve}}, reference)


FIGURES = {
    "forest, of means alone": (lambda: forest((NAN, NAN, NAN)), [MEAN]),
    "forest, with floors": (lambda: forest((NAN, NAN, NAN), (-1, 1, NAN)), [MEAN, FLOOR]),
    "forest, with published values": (lambda: forest((NAN, NAN, 1)), [MEAN, PUBLISHED]),
    "forest, with all": (lambda: forest((-1, 1, 1)), [MEAN, FLOOR, PUBLISHED]),
    "search, of nothing": (history, []),
    "search, all with all seeds": (lambda: history((0.9, [0.9], True)), [ALL, BEST]),
    "search, none with all seeds": (lambda: history((0.9, [0.9], False)), [GIVEN]),
    "search, without results": (lambda: history((NAN, [], False)), [NONE]),
    "search, of each kind": (
        lambda: history((0.9, [0.9], True), (0.8, [0.8], False), (NAN, [], False)), [ALL, GIVEN, BEST, NONE]
    ),
    "difference, without intervals": (lambda: difference((-0.1, NAN, NAN)), [BETTER, WORSE]),
    "difference, all certain": (lambda: difference((-0.1, -0.2, -0.05)), [BETTER, WORSE]),
    "difference, one uncertain": (lambda: difference((-0.1, -0.2, -0.05), (0, -1, 1)), [BETTER, WORSE, PALE]),
    "difference, with a floor": (lambda: difference((-0.1, -0.2, -0.05, 0.1)), [BETTER, WORSE, SEEDS]),
    "matrix, of similarities alone": (matrix, []),
    "matrix, with places": (lambda: matrix([[0], [1]]), ["same place"]),
    "matrix, of other places": (lambda: matrix([[], []]), []),
    "matrix, with matches": (lambda: matrix([[0], [1]], np.array([0, 0])), ["same place", "wrong: 1", "right: 1"]),
    "invariance, without reference": (lambda: invariance(None), ["pixels"]),
    "invariance, with it": (lambda: invariance({"fog": 0.0}), ["pixels", "in the reference images"]),
    "invariance, of another factor": (lambda: invariance({"rain": 0.0}), ["pixels"]),
}  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_a_legend_has_what_is_drawn(name):
    make, expected = FIGURES[name]
    found = entries(make())
    assert len(found) == len(expected), found
    assert all(text.startswith(start) for text, start in zip(found, expected, strict=True)), found


@pytest.mark.parametrize(
    ("lost", "expected"),
    [
        ([False, False], ["localized", "first"]),
        ([True, False], ["lost (1 image)", "localized", "first"]),
        ([True, True], ["lost (2 images)"]),
    ],
)
def test_a_trajectory_of_lost_images_has_no_localized_ones(lost, expected, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr("sextant.figures.style.save_figure", lambda figure, *_: drawn.append(figure))
    rows = [
        SimpleNamespace(told=SimpleNamespace(pose=np.array([k, 0.0, 0.0]), lost=each)) for k, each in enumerate(lost)
    ]
    draw_trajectory(rows, np.array([[0.0, 0], [1, 0]]), tmp_path)
    assert entries(drawn[0]) == expected
