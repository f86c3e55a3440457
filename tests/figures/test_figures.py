"""What each figure shows, read from its artists; and that all of them can be drawn."""

import numpy as np
import pytest
import torch
from figures.written import legend_of, tick_labels
from matplotlib.colors import to_hex
from PIL import Image
from torch import nn

from sextant.chapters.classification.figures import first_kernels, severity_curves
from sextant.figures.confusion_matrix import confusion_matrix
from sextant.figures.effects import ForestRow, contrast_forest
from sextant.figures.gallery import contact_sheet, gallery
from sextant.figures.style import save_figure
from sextant.layers import PushPullConv2d
from sextant.models import LeNet

NAN = float("nan")
LABELS, PREDICTIONS = np.array([0, 0, 0, 1, 2]), np.array([0, 0, 1, 1, 1])
CLASSES = ("cat", "dog", "fish")
LEVELS = {"gaussian": [0.1, 0.5], "contrast_poisson": [0.4]}
ACCURACY = {
    "plain": {"clean": 0.99, "gaussian/0.1": 0.9, "gaussian/0.5": 0.6, "contrast_poisson/0.4": 0.7},
    "inhibited": {"clean": 0.98, "gaussian/0.1": 0.95, "gaussian/0.5": 0.8, "contrast_poisson/0.4": 0.9},
}
INTERVALS = {model: {key: (v - 0.05, v + 0.05) for key, v in scores.items()} for model, scores in ACCURACY.items()}


def a_confusion_matrix():
    return confusion_matrix(LABELS, PREDICTIONS, CLASSES)


def a_contact_sheet(channels=1):
    images = np.random.default_rng(0).uniform(-0.5, 1.5, size=(2, 5, channels, 8, 6))
    predictions = {"clean": LABELS, "gaussian/0.1": PREDICTIONS}
    return contact_sheet(dict(zip(predictions, images, strict=True)), predictions, LABELS, CLASSES), images


def a_forest():
    rows = [ForestRow("clean", 0.1, -0.1, 0.3, -0.5, 0.5, 0.2), ForestRow("noisy", 9.0, 7.0, 11.0, NAN, NAN, NAN)]
    return contrast_forest([("LeNet A", rows), ("LeNet B", rows[:1])], "accuracy difference")


def some_kernels():
    return first_kernels(LeNet("A", 1, (28, 28), 10))


def a_gallery():
    return gallery([np.full((8, 8), 20 * i, np.uint8) for i in range(10)], [f"image {i}" for i in range(10)])


@pytest.mark.parametrize(
    "make",
    [
        a_confusion_matrix,
        lambda: a_contact_sheet()[0],
        a_forest,
        some_kernels,
        a_gallery,
        lambda: severity_curves(LEVELS, ACCURACY, INTERVALS),
    ],
)
def test_every_figure_is_saved_as_a_picture_with_ink(make, tmp_path):
    (path,) = save_figure(make(), tmp_path / "figures", "name")
    assert path == tmp_path / "figures" / "name.png"
    with Image.open(path) as picture:
        assert picture.info["dpi"] == pytest.approx((150, 150), abs=0.1)
        assert min(picture.size) > 100
        assert len(picture.convert("L").getcolors()) > 16


def test_a_figure_is_saved_in_every_format_asked_for_and_vectors_without_a_date(tmp_path):
    paths = save_figure(a_forest(), tmp_path, "forest", ("png", "svg"))
    assert [path.name for path in paths] == ["forest.png", "forest.svg"]
    assert b"<svg" in paths[1].read_bytes()
    assert b"<dc:date>" not in paths[1].read_bytes()


def test_a_confusion_matrix_counts_true_classes_by_row_and_predictions_by_column():
    (axes,) = a_confusion_matrix().axes
    counts = {(int(text.get_position()[1]), int(text.get_position()[0])): text.get_text() for text in axes.texts}
    assert counts == {(0, 0): "2", (0, 1): "1", (1, 1): "1", (2, 1): "1"}
    np.testing.assert_allclose(axes.images[0].get_array(), [[2 / 3, 1 / 3, 0], [0, 1, 0], [0, 1, 0]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("predicted", "true")
    assert tuple(tick_labels(axes.xaxis)) == tuple(tick_labels(axes.yaxis)) == CLASSES


def test_a_class_that_never_occurs_has_an_empty_row():
    (axes,) = confusion_matrix(np.array([0, 1]), np.array([0, 0]), CLASSES).axes
    assert not axes.images[0].get_array()[2].any()


@pytest.mark.parametrize("channels", [1, 3])
def test_a_contact_sheet_has_a_row_for_each_condition_and_a_column_for_each_image(channels):
    figure, images = a_contact_sheet(channels)
    (axes,) = figure.axes
    picture = np.asarray(axes.images[0].get_array()).reshape(2 * 8, 5 * 6, channels)
    for row, column in np.ndindex(2, 5):
        cell = picture[8 * row : 8 * (row + 1), 6 * column : 6 * (column + 1)]
        np.testing.assert_array_equal(cell, images[row, column].clip(0, 1).transpose(1, 2, 0))
    assert tick_labels(axes.yaxis) == ["clean", "gaussian/0.1"]


def test_a_contact_sheet_writes_each_prediction_into_its_image_red_where_it_is_wrong():
    (axes,) = a_contact_sheet()[0].axes
    texts = sorted(axes.texts, key=lambda text: text.get_position()[::-1])
    assert [text.get_text() for text in texts] == [CLASSES[i] for i in (*LABELS, *PREDICTIONS)]
    red = [int(to_hex(text.get_color())[1:3], 16) > 200 for text in texts]
    assert red == [False] * 5 + list(PREDICTIONS != LABELS)


def test_severity_curves_have_a_panel_for_each_corruption_and_a_line_for_each_model():
    gaussian, poisson = severity_curves(LEVELS, ACCURACY).axes
    assert [panel.get_xlabel() for panel in (gaussian, poisson)] == ["gaussian", "contrast poisson"]
    assert tick_labels(gaussian.xaxis) == ["clean", "0.1", "0.5"]
    assert tick_labels(poisson.xaxis) == ["clean", "0.4"]
    drawn = {line.get_label(): line.get_ydata() for line in gaussian.lines}
    assert drawn == {"plain": pytest.approx([99, 90, 60]), "inhibited": pytest.approx([98, 95, 80])}
    assert legend_of(gaussian) == ["plain", "inhibited"]
    assert not gaussian.collections


def test_a_single_severity_curve_needs_no_legend():
    gaussian, _ = severity_curves(LEVELS, {"plain": ACCURACY["plain"]}).axes
    assert gaussian.get_legend() is None


def test_severity_curves_draw_intervals_as_bands_around_their_lines():
    gaussian, _ = severity_curves(LEVELS, ACCURACY, INTERVALS).axes
    for line, band in zip(gaussian.lines, gaussian.collections, strict=True):
        low, high = (band.get_paths()[0].get_extents().get_points()[:, 1]).tolist()
        assert (low, high) == pytest.approx((min(line.get_ydata()) - 5, max(line.get_ydata()) + 5))


def test_a_forest_draws_means_intervals_and_published_values_row_by_row():
    first, second = a_forest().axes
    lines = [list(line.get_xdata()) for line in first.lines if line.get_label().startswith("_")]
    means, published, zero = [[0.1], [9.0]], [[0.2], [NAN]], [0, 0]
    expected = [[-0.1, 0.3], means[0], published[0], [7.0, 11.0], means[1], published[1], zero]
    np.testing.assert_equal(lines, expected)
    assert (first.get_title(), second.get_title()) == ("LeNet A", "LeNet B")
    assert tick_labels(first.yaxis) == ["clean", "noisy"]
    assert tick_labels(second.yaxis) == [""]


def test_a_forests_grey_band_spans_the_noise_floor():
    band = a_forest().axes[0].collections[0].get_paths()[0].get_extents()
    assert (band.xmin, band.xmax) == (-0.5, 0.5)


def test_panels_of_a_forest_list_their_first_row_at_the_top():
    for panel in a_forest().axes:
        bottom, top = panel.get_ylim()
        assert bottom > top


@pytest.mark.parametrize(
    ("conv", "names", "columns"),
    [
        (nn.Conv2d(1, 6, 5), ["kernel"], 6),
        (nn.Conv2d(3, 40, 3), ["kernel"], 16),
        (PushPullConv2d(3, 4, 3, scale=2.0), ["push", "pull"], 4),
    ],
)
def test_kernels_are_shown_in_a_row_and_pull_kernels_below_their_push_kernels(conv, names, columns):
    axes = first_kernels(nn.Sequential(conv)).axes
    assert len(axes) == len(names) * columns
    assert [cell.get_ylabel() for cell in axes if cell.get_ylabel()] == names


def test_pull_kernels_are_shown_wide_and_with_their_sign_turned():
    conv = PushPullConv2d(2, 1, 3, scale=2.0, bias=False)
    nn.init.ones_(conv.weight)
    push, pull = (np.asarray(cell.images[0].get_array()) for cell in first_kernels(nn.Sequential(conv)).axes)
    np.testing.assert_allclose(push, np.ones((3, 3)))
    np.testing.assert_allclose(pull, -np.ones((7, 7)))


def test_kernels_of_colour_images_are_shown_in_colour_with_zero_as_middle_grey():
    conv = nn.Conv2d(3, 1, 1, bias=False)
    conv.weight.data = torch.tensor([1.0, 0.0, -1.0]).view(1, 3, 1, 1)
    (cell,) = first_kernels(nn.Sequential(conv)).axes
    np.testing.assert_allclose(cell.images[0].get_array(), [[[1, 0.5, 0]]])


def test_a_network_without_convolution_has_no_kernels_to_show():
    assert first_kernels(nn.Sequential(nn.Linear(4, 2))) is None


def test_a_gallery_has_eight_titled_images_a_row_and_leaves_the_rest_blank():
    cells = a_gallery().axes
    assert [len(cell.images) for cell in cells] == [1] * 10 + [0] * 6
    assert [cell.get_title() for cell in cells[:10]] == [f"image {i}" for i in range(10)]
    assert not any(cell.axison for cell in cells)
