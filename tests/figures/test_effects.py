"""Errors against costs: the names of variants that cost alike."""

import pytest

from sextant.figures.effects import CostPoint, error_against_cost


@pytest.mark.parametrize("errors", [(28.0, 31.0, 25.0), (31.0, 28.0, 25.0), (28.0, 28.0, 28.0)])
def test_names_of_variants_that_cost_alike_overlap_neither_each_other_nor_a_bar(errors):
    costs = [("none", 1.0), ("first", 1.06), ("last", 1.06)]
    points = [CostPoint(*named, error, error - 2, error + 2) for named, error in zip(costs, errors, strict=True)]
    points.append(CostPoint("all", 6.4, 35.0, 33.0, 37.0))
    figure = error_against_cost({("clean", "ResNet-20"): points}, cost="cost", quantity="error (%)")
    figure.draw_without_rendering()
    (axes,) = figure.axes
    names = [text.get_window_extent() for text in axes.texts]
    assert not [(a, b) for k, a in enumerate(names) for b in names[:k] if a.overlaps(b)]
    for point in points:
        (x, low), (_, high) = axes.transData.transform([(point.cost, point.low), (point.cost, point.high)])
        assert not [name for name in names if name.x0 < x < name.x1 and name.y0 < high and name.y1 > low]
