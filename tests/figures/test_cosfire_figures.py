"""What the figures of COSFIRE show, read from their artists."""

import math

import numpy as np
import pytest
import torch
from figures.written import legend_of
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, Rectangle

from sextant.chapters.cosfire.figures import AROUND, BAR_LENGTH, cosfire_filter, cosfire_responses, recognition_errors
from sextant.chapters.cosfire.report import file_names
from sextant.figures.style import COLOURS, save_figure
from sextant.layers.cosfire import (
    Blur,
    ChannelPeaks,
    ConcentricCircles,
    Cosfire,
    DoGBank,
    FeatureBank,
    GaborBank,
    VectorBank,
    VectorKeypoints,
)


def corner(size=48):
    """A dark bar from the middle to the right, and one upwards."""
    image = torch.ones(1, size, size)
    image[:, size // 2 - 1 : size // 2 + 2, size // 2 :] = 0
    image[:, : size // 2, size // 2 - 1 : size // 2 + 2] = 0
    return image


def discs(axes):
    return [patch for patch in axes.patches if isinstance(patch, Circle) and patch.get_fill()]


def circles(axes):
    return sorted({patch.radius for patch in axes.patches if isinstance(patch, Circle) and not patch.get_fill()})


def test_parts_of_a_gabor_filter_are_bars_where_the_example_has_bars(tmp_path):
    filters = Cosfire(GaborBank((6.0,)), ConcentricCircles((0, 10, 18)), blur=Blur(1.0, 0.1))
    filters.configure(corner(), (24.0, 24.0))
    figure = cosfire_filter(filters, corner(), (24.0, 24.0), title="a corner")
    axes = figure.axes[0]
    assert circles(axes) == [10, 18]
    parts = filters.tuples(0)
    assert len(discs(axes)) == len(parts) > 2
    east = next(i for i in range(len(parts)) if parts.rho[i] == 18 and abs(math.cos(float(parts.phi[i])) - 1) < 1e-3)
    disc = discs(axes)[east]
    assert disc.center[0] == pytest.approx(24 + 18, abs=0.05)
    assert disc.center[1] == pytest.approx(24, abs=0.05)
    assert disc.radius == pytest.approx(1.0 + 0.1 * 18)
    bars = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    # the bar to the right lies along x: its long side, in the data's coordinates
    corners = axes.transData.inverted().transform(bars[east].get_transform().transform(np.array([[0, 0], [0, 1.0]])))
    long_side = corners[1] - corners[0]
    assert np.abs(long_side) == pytest.approx([BAR_LENGTH * 6, 0], abs=1e-6)
    assert bars[east].get_width() == 3
    assert legend_of(figure) == ["λ 6 px"]
    assert axes.get_title() == "a corner"
    assert save_figure(figure, tmp_path, "filter")[0].stat().st_size > 1000


def test_bars_turn_with_their_direction():
    image = torch.ones(1, 61, 61)
    for t in np.linspace(-40, 40, 400):  # up to the right at 30 degrees
        x, y = 30 + t * math.cos(math.radians(30)), 30 - t * math.sin(math.radians(30))
        if 1 <= x < 60 and 1 <= y < 60:
            image[0, round(y) - 1 : round(y) + 2, round(x)] = 0
    filters = Cosfire(GaborBank((6.0,), orientations=12), ConcentricCircles((0,)))
    figure = cosfire_filter(filters.configure(image), image)
    axes, bars = figure.axes[0], [p for p in figure.axes[0].patches if isinstance(p, Rectangle)]
    ends = axes.transData.inverted().transform(bars[0].get_transform().transform(np.array([[0, 0], [0, 1.0]])))
    across, down = ends[1] - ends[0]
    assert math.degrees(math.atan2(-down, across)) % 180 == pytest.approx(30, abs=0.01)


def test_of_a_large_example_the_neighbourhood_is_shown():
    large = torch.ones(1, 400, 600)
    large[:, 100:148, 300:348] = corner()
    filters = Cosfire(GaborBank((6.0,)), ConcentricCircles((0, 10)), blur=Blur(1.0, 0.1)).configure(large, (324, 124))
    axes = cosfire_filter(filters, large, (324, 124)).axes[0]
    assert axes.get_xlim() == pytest.approx((324 - AROUND * 12, 324 + AROUND * 12))  # a radius of 10 and its σ of 2
    assert axes.get_ylim() == pytest.approx((124 + AROUND * 12, 124 - AROUND * 12))
    small = cosfire_filter(filters, large[:, 118:130, 318:330], (6, 6)).axes[0]
    assert (small.get_xlim(), small.get_ylim()) == ((-0.5, 11.5), (11.5, -0.5))


def test_weight_is_opacity():
    filters = Cosfire(GaborBank((6.0,)), ConcentricCircles((0, 10, 18)), least_weight=0.2).configure(corner())
    drawn = discs(cosfire_filter(filters, corner()).axes[0])
    rho = filters.tuples(0).rho.numpy()
    opacity = np.array([disc.get_alpha() for disc in drawn])
    assert opacity[rho == 0] == pytest.approx(opacity.max())
    assert opacity[rho == 18].max() < opacity[rho == 10].min() < opacity[rho == 0].min()


def test_differences_of_gaussians_are_coloured_by_channel():
    filters = Cosfire(DoGBank((2.0,), polarities=(1, -1)), ConcentricCircles((0, 6), relative_to="place", t2=0.0))
    figure = cosfire_filter(filters.configure(corner(), (24.0, 24.0)), corner(), (24.0, 24.0))
    assert set(legend_of(figure)) == {"bright, σ 2 px", "dark, σ 2 px"}
    assert {to_hex(disc.get_facecolor()) for disc in discs(figure.axes[0])} == {c.lower() for c in COLOURS[:2]}
    assert not [patch for patch in figure.axes[0].patches if isinstance(patch, Rectangle)]


def test_features_of_a_network_are_drawn_in_pixels_of_the_image():
    torch.manual_seed(0)
    network = torch.nn.Sequential(torch.nn.Conv2d(3, 6, 3, 2, 1), torch.nn.ReLU(), torch.nn.Conv2d(6, 5, 3, 2, 1))
    example = torch.rand(3, 32, 48)
    for bank, strategy in ((FeatureBank, ChannelPeaks), (VectorBank, VectorKeypoints)):
        filters = Cosfire(bank(network.eval(), 5), strategy(reach=3.0), blur=Blur(0.5, 0.0)).configure(example)
        axes = cosfire_filter(filters, example).axes[0]
        parts = filters.tuples(0)
        assert [disc.radius for disc in discs(axes)] == pytest.approx([4 * 0.5] * len(parts))
        apart = [math.hypot(disc.center[0] - 24, disc.center[1] - 16) for disc in discs(axes)]
        assert apart == pytest.approx((4 * parts.rho).tolist())


def test_responses_lie_over_the_image_and_points_have_scores(tmp_path):
    image = np.full((30, 40), 90, np.uint8)
    response = np.zeros((15, 20))
    response[5, 7] = 0.8
    figure = cosfire_responses(image, response, [(14.5, 10.5, 0.8), (3, 4, 0.25)], strongest=1.0, title="a.png")
    plain, overlay, found = figure.axes[:3]
    assert [cell.get_title() for cell in (plain, overlay, found)] == ["image", "response", "2 found"]
    assert overlay.images[1].get_extent() == [-0.5, 39.5, 29.5, -0.5]
    assert overlay.images[1].get_clim() == (0, 1)
    assert overlay.images[1].get_alpha()[5, 7] > overlay.images[1].get_alpha()[0, 0] == 0
    assert [text.get_text() for text in found.texts] == ["0.80", "0.25"]
    assert found.lines[0].get_xydata().tolist() == [[14.5, 10.5]]
    assert save_figure(figure, tmp_path, "responses")[0].stat().st_size > 1000


@pytest.mark.parametrize("shape", [(8, 9, 1), (8, 9, 3)])
def test_images_of_any_kind_and_nothing_found(shape):
    figure = cosfire_responses(np.zeros(shape, np.uint8), np.zeros((8, 9), np.float32))
    assert figure.axes[2].get_title() == "0 found"
    assert not figure.axes[1].images[1].get_alpha().any()


def test_errors_are_shown_with_truth_and_answer():
    labels = np.array([0, 1, 2, 0, 1])
    answers = np.array([0, 2, 2, 1, 0])
    images = np.arange(5, dtype=np.uint8)[:, None, None, None] * np.ones((1, 1, 4, 4), np.uint8)
    figure = recognition_errors(images, labels, answers, ["a", "b", "c"], title="svm")
    assert [cell.get_title() for cell in figure.axes] == ["b → c", "a → b", "b → a"]
    assert [int(cell.images[0].get_array()[0, 0]) for cell in figure.axes] == [1, 3, 4]
    assert figure.get_suptitle() == "svm: 3 of 5 wrong (60.00 %)"
    assert recognition_errors(images, labels, labels, ["a", "b", "c"]) is None


def test_figures_of_classes_with_any_names_have_files_of_their_own():
    labels = torch.tensor([0, 0, 1, 2])
    assert file_names(["猫", "犬", "a/b"], labels) == {0: "猫", 2: "犬", 3: "a_b"}
    assert file_names(["a b", "a_b", "c"], labels) == {0: "a_b_0", 2: "a_b_2", 3: "c"}


def test_of_many_errors_an_even_choice_is_shown():
    labels = np.repeat(np.arange(10), 100)
    images = np.zeros((1000, 3, 4, 4), np.uint8)
    figure = recognition_errors(images, labels, (labels + 1) % 10, [str(k) for k in range(10)])
    shown = [cell for cell in figure.axes if cell.images]
    assert len({cell.get_title()[0] for cell in shown}) == 10
    assert figure.get_suptitle() == "1,000 of 1,000 wrong (100.00 %), 40 shown"
