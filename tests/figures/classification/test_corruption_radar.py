"""What the radar chart shows, read from its artists."""

import numpy as np
import pytest
from figures.written import legend_of, texts, tick_labels

from sextant.chapters.classification.figures import (
    DifferenceBar,
    corruption_difference,
    corruption_heatmap,
    corruption_radar,
)
from sextant.evaluation import ALL_19, CORRUPTION_FAMILIES
from sextant.figures.style import save_figure

ERRORS = {
    "conv": {"fog": 0.1, "gaussian_noise": 0.42, "stripe": 0.3},
    "push_pull": {"stripe": 0.2, "gaussian_noise": 0.25, "fog": 0.15},
}


def test_every_model_is_a_closed_outline_in_per_cent_in_the_order_of_the_families():
    figure = corruption_radar(ERRORS, families=CORRUPTION_FAMILIES)
    (axes,) = figure.axes
    conv, push_pull = axes.lines
    assert conv.get_ydata() == pytest.approx([42, 10, 30, 42])
    assert push_pull.get_ydata() == pytest.approx([25, 15, 20, 25])
    turns = np.array([0, 1, 2, 0]) / 3
    assert conv.get_xdata() == pytest.approx(2 * np.pi * turns)
    assert legend_of(figure) == ["conv", "push_pull"]
    assert [text for text in texts(axes) if text] == ["noise", "weather", "gaussian noise", "fog", "stripe"]


def test_outlines_differ_in_more_than_colour():
    conv, push_pull = corruption_radar(ERRORS).axes[0].lines
    assert conv.get_linestyle() != push_pull.get_linestyle()
    assert conv.get_marker() != push_pull.get_marker()


def test_the_scale_starts_at_zero_and_holds_the_largest_error():
    for highest, limit in ((0.42, 50), (0.99, 100), (1.0, 100), (0.03, 3), (0.0, 1)):
        errors = {"a": {"fog": highest, "snow": 0.0, "frost": 0.0}}
        assert corruption_radar(errors).axes[0].get_ylim() == pytest.approx((0, limit))


def test_a_sector_covers_its_family():
    sectors = corruption_radar({"a": dict.fromkeys(ALL_19, 0.2)}, families=CORRUPTION_FAMILIES).axes[0].patches
    assert [sector.get_width() for sector in sectors] == pytest.approx([2 * np.pi * n / 19 for n in (3, 4, 4, 4, 4)])
    shades = [sector.get_facecolor() for sector in sectors]
    assert all(one != other for one, other in zip(shades, [*shades[1:], shades[0]], strict=True))


@pytest.mark.parametrize(
    "errors", [{}, {"a": {"fog": 0.1, "snow": 0.1}}, {"a": ERRORS["conv"], "b": {"fog": 0.1, "snow": 0.1, "frost": 0}}]
)
def test_it_needs_the_same_three_corruptions(errors):
    with pytest.raises(ValueError, match="the same corruptions of every model, at least 3"):
        corruption_radar(errors)


def test_it_can_be_written(tmp_path):
    (path,) = save_figure(corruption_radar(ERRORS), tmp_path, "radar")
    assert path.stat().st_size > 1000


def test_a_heat_map_of_one_severity_has_no_mean_beside():
    (axes,) = corruption_heatmap({"fog": (0.25,), "stripe": (0.5,)}, clean=0.1, levels=["one each"]).axes
    assert tick_labels(axes.xaxis) == ["one each"]
    assert [text for text in texts(axes) if text] == ["25.0", "50.0"]
    assert axes.get_title() == "clean 10.00 %, mean 37.50 %"


def test_a_diamond_marks_the_noise_floor():
    figure = corruption_difference([DifferenceBar("fog", 0.1, floor=-0.02), DifferenceBar("snow", 0.1)])
    (axes,) = figure.axes
    diamonds = [line for line in axes.lines if line.get_marker() == "D"]
    assert [float(line.get_xdata()[0]) for line in diamonds] == pytest.approx([-2])
    assert legend_of(figure)[-1] == "seeds alone (noise floor)"
