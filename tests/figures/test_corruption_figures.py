"""What the figures of corruption errors show, read from their artists."""

import numpy as np
import pytest
from figures.written import legend_of, texts, tick_labels
from matplotlib.colors import to_hex

from sextant.chapters.classification.figures import (
    BETTER,
    WORSE,
    DifferenceBar,
    by_family,
    corruption_difference,
    corruption_heatmap,
)
from sextant.evaluation.corruption_errors import CORRUPTION_FAMILIES
from sextant.figures.style import save_figure

ERRORS = {"fog": (0.1, 0.4), "gaussian_noise": (0.2, 0.9), "stripe": (0.3,)}
BARS = [
    DifferenceBar("fog", 0.02, -0.01, 0.05),
    DifferenceBar("gaussian_noise", -0.1, -0.12, -0.08),
    DifferenceBar("stripe", 0.03, 0.01, 0.05),
    DifferenceBar("snow", 0.0, 0.0, 0.0),
]


def test_corruptions_are_sorted_into_families_and_the_others_come_last():
    assert by_family(ERRORS, CORRUPTION_FAMILIES) == [
        ("noise", ["gaussian_noise"]),
        ("weather", ["fog"]),
        ("", ["stripe"]),
    ]
    assert by_family(["b", "a"], {}) == [("", ["b", "a"])]


def test_a_heat_map_has_a_row_for_each_corruption_and_the_mean_beside():
    (axes,) = corruption_heatmap(ERRORS, families=CORRUPTION_FAMILIES).axes
    assert tick_labels(axes.yaxis) == ["gaussian noise", "fog", "stripe"]
    assert tick_labels(axes.xaxis) == ["1", "2", "mean"]
    expected = [[0.2, 0.9, 0.55], [0.1, 0.4, 0.25], [0.3, np.nan, 0.3]]
    np.testing.assert_allclose(np.ma.filled(axes.images[0].get_array(), np.nan), expected)
    assert texts(axes) == ["20.0", "90.0", "55.0", "10.0", "40.0", "25.0", "30.0", "30.0", "noise", "weather", ""]


def test_numbers_are_written_light_on_dark_and_dark_on_light():
    (axes,) = corruption_heatmap(ERRORS).axes
    colours = {text.get_text(): text.get_color() for text in axes.texts}
    assert (colours["90.0"], colours["10.0"]) == ("white", "black")


def test_a_heat_map_tells_the_model_its_clean_error_and_the_mean_over_corruptions():
    (axes,) = corruption_heatmap(ERRORS, clean=0.0715, title="ResNet", levels=["low", "high"]).axes
    assert axes.get_title() == "ResNet\nclean 7.15 %, mean 36.67 %"
    assert tick_labels(axes.xaxis) == ["low", "high", "mean"]


def test_the_colours_of_two_models_mean_the_same():
    limits = {corruption_heatmap({"fog": (error,)}).axes[0].images[0].get_clim() for error in (0.1, 0.9)}
    assert limits == {(0.0, 1.0)}


def test_a_difference_has_a_bar_and_a_whisker_in_percentage_points():
    (axes,) = corruption_difference(
        BARS, mean=DifferenceBar("mean", -0.01, -0.02, 0.01), families=CORRUPTION_FAMILIES
    ).axes
    assert tick_labels(axes.yaxis) == ["gaussian noise", "snow", "fog", "stripe", "mean"]
    widths = [bar.get_width() for bar in axes.patches]
    assert widths == pytest.approx([-10, 0, 2, 3, -1])
    whiskers = [list(line.get_xdata()) for line in axes.lines[:5]]
    assert whiskers == [pytest.approx(ends) for ends in ([-12, -8], [0, 0], [-1, 5], [1, 5], [-2, 1])]


def test_better_is_blue_worse_is_orange_and_pale_what_may_be_chance():
    (axes,) = corruption_difference(BARS).axes
    fog, noise, stripe, snow = axes.patches
    assert [to_hex(bar.get_facecolor()) for bar in (fog, noise, stripe)] == [
        WORSE.lower(),
        BETTER.lower(),
        WORSE.lower(),
    ]
    assert [bar.get_alpha() for bar in (fog, noise, stripe, snow)] == [0.35, 0.9, 0.9, 0.35]


def test_the_legend_counts_wins_and_losses_but_not_the_mean_nor_ties():
    figure = corruption_difference(BARS, mean=DifferenceBar("mean", -0.01, -0.02, -0.001))
    assert legend_of(figure) == [
        "better on 1 of 4 (1 certain)",
        "worse on 2 of 4 (1 certain)",
        "pale: interval contains 0 (95 % over seeds)",
    ]


def test_without_intervals_nothing_is_pale_and_nothing_certain():
    figure = corruption_difference([DifferenceBar("fog", -0.1), DifferenceBar("snow", 0.1)])
    (axes,) = figure.axes
    assert [bar.get_alpha() for bar in axes.patches] == [0.9, 0.9]
    assert legend_of(figure) == ["better on 1 of 2", "worse on 1 of 2"]
    assert len(axes.lines) == 1


def test_the_first_corruption_is_at_the_top():
    bottom, top = corruption_difference(BARS).axes[0].get_ylim()
    assert bottom > top


@pytest.mark.parametrize("draw", [lambda: corruption_heatmap({}), lambda: corruption_difference([])])
def test_nothing_cannot_be_drawn(draw):
    with pytest.raises(ValueError, match="needs at least one corruption"):
        draw()


@pytest.mark.parametrize("draw", [lambda: corruption_heatmap(ERRORS, clean=0.1), lambda: corruption_difference(BARS)])
def test_the_figures_can_be_written(draw, tmp_path):
    for path in save_figure(draw(), tmp_path, "figure", ("png", "svg")):
        assert path.stat().st_size > 1000
