import numpy as np
import pytest
from figures.written import legend_of
from matplotlib.colors import to_hex

from sextant.figures.factor_curves import FactorCurve, factor_curves
from sextant.figures.style import COLOURS

NONE = np.full(3, np.nan)
WORSE = FactorCurve(np.array([50.0, 60, 70]), np.array([40.0, 50, 60]), np.array([60.0, 70, 80]))
BETTER = FactorCurve(np.array([40.0, 75, np.nan]), NONE, NONE)


def test_lines_have_bands_and_the_one_that_ends_highest_is_first_in_the_legend():
    levels = np.array([1.0, 5, 20])
    figure = factor_curves("examples", levels, {"test": {"svm": WORSE, "cosfire": BETTER}}, quantity="accuracy (%)")
    (axes,) = figure.axes
    assert legend_of(figure) == ["cosfire", "svm"]
    cosfire, svm = axes.lines
    np.testing.assert_allclose(svm.get_xydata(), [[1, 50], [5, 60], [20, 70]])
    np.testing.assert_allclose(cosfire.get_xydata(), [[1, 40], [5, 75], [20, np.nan]])
    assert [to_hex(line.get_color()) for line in (svm, cosfire)] == [COLOURS[0].lower(), COLOURS[1].lower()]
    assert axes.collections[1].get_paths()[0].vertices[:, 1].max() == pytest.approx(80)
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1", "5", "20"]
    assert (axes.get_xscale(), axes.get_xlabel(), axes.get_ylabel()) == ("log", "examples", "accuracy (%)")


def test_a_panel_a_condition_and_more_arms_than_colours():
    arms = {f"arm{number}": WORSE for number in range(9)}
    figure = factor_curves("rate", np.array([0.0, 1, 2]), dict.fromkeys("abcd", arms), quantity="x", title="of lenet")
    assert [axes.get_title() for axes in figure.axes] == ["a", "b", "c", "d"]
    looks = {(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines}
    assert len(looks) == 9
    assert figure.axes[0].get_xscale() == "linear"


@pytest.mark.parametrize(
    ("levels", "scale"),
    [([1, 10, 100], "log"), ([0, 1e-5, 1e-2], "symlog"), ([1, 2, 3], "linear"), ([-1, 1, 20], "linear")],
)
def test_values_that_are_far_apart_are_on_a_logarithmic_axis(levels, scale):
    (axes,) = factor_curves("f", np.array(levels, float), {"test": {"a": WORSE}}, quantity="x").axes
    assert axes.get_xscale() == scale


def test_wide_intervals_are_cut_off_rather_than_flatten_the_lines():
    wide = FactorCurve(np.array([98.0, 98.5, 99]), np.full(3, 60.0), np.full(3, 130.0))
    (axes,) = factor_curves("f", np.array([1.0, 2, 3]), {"test": {"a": wide}}, quantity="x").axes
    assert axes.get_ylim() == pytest.approx((98 - 0.15, 99 + 0.15))


@pytest.mark.parametrize(
    ("levels", "panels", "message"),
    [([1, 2, 3], {"test": {}}, "at least one curve"), ([3, 2, 1], {"test": {"a": WORSE}}, "must ascend")],
)
def test_what_no_curve_can_be_drawn_of_is_refused(levels, panels, message):
    with pytest.raises(ValueError, match=message):
        factor_curves("f", np.array(levels, float), panels, quantity="x")
