"""Errors against costs: the names of variants that cost alike."""

import pytest

from sextant.figures.effects import CostPoint, error_against_cost


@pytest.mark.parametrize(("first", "second"), [(28.0, 31.0), (31.0, 28.0)])
def test_names_of_variants_that_cost_alike_overlap_neither_each_other_nor_a_bar(first, second):
    pairs = [("none", 1.0, first), ("first", 1.06, second), ("all", 6.4, 35.0)]
    points = [CostPoint(name, cost, error, error - 2, error + 2) for name, cost, error in pairs]
    figure = error_against_cost({("clean", "ResNet-20"): points}, cost="cost", quantity="error (%)")
    figure.draw_without_rendering()
    (axes,) = figure.axes
    names = [text.get_window_extent() for text in axes.texts]
    assert not names[0].overlaps(names[1])
    for point in points:
        (x, low), (_, high) = axes.transData.transform([(point.cost, point.low), (point.cost, point.high)])
        assert not [name for name in names if name.x0 < x < name.x1 and name.y0 < high and name.y1 > low]
