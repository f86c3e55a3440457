"""What the figures of calibration show, read from their artists; and that all of them can be drawn."""

import math

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from PIL import Image

from sextant.chapters.calibration.figures.errors import (
    binned_quartiles,
    coverage_curves,
    error_by_parameter,
    predicted_against_true,
    sparsification_curves,
)
from sextant.chapters.calibration.figures.overlay import calibration_sheet
from sextant.chapters.calibration.metrics.sparsification import sparsification
from sextant.evaluation.conformal import coverage_curve
from sextant.figures.style import COLOURS, save_figure
from sextant.geometry import CameraParameters

N = 160
G = np.random.default_rng(0)
NAMES = ["tilt", "roll", "vfov", "k1 / f²"]


def cameras(*rows):
    columns = zip(*rows, strict=True)
    return CameraParameters(*(torch.tensor(column, dtype=torch.float64) for column in columns))


TRUTH = cameras(*zip(*(G.uniform(*ends, N) for ends in ((-0.5, 0.5), (-0.3, 0.3), (0.5, 1.4), (-0.4, 0))), strict=True))
PREDICTED = TRUTH._replace(tilt=0.5 * TRUTH.tilt)


def an_error_figure():
    tilt = np.degrees(np.abs(TRUTH.tilt.numpy()))
    twice, half = {"tilt_deg": 2 * tilt, "k1": np.ones(N)}, {"tilt_deg": tilt / 2, "k1": np.full(N, np.nan)}
    return error_by_parameter(TRUTH, {"twice": twice, "half": half}, ("tilt_deg", "k1"))


def a_scatter():
    return predicted_against_true(TRUTH, PREDICTED)


def a_curve():
    scores = torch.from_numpy(G.uniform(size=(120, 4)))
    return coverage_curve(scores[:80], scores[80:], np.arange(40) // 4, resamples=50)


def a_coverage_figure():
    return coverage_curves(a_curve(), NAMES)


RESULT = sparsification(np.arange(1.0, 51), np.random.default_rng(1).permutation(50).astype(float))


def a_sparsification_figure():
    return sparsification_curves({"tilt": RESULT, "roll": RESULT})


def a_sheet(count=5):
    images = torch.randint(0, 256, (count, 3, 12, 16), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    aspect = torch.tensor([1.0, 4 / 3, 1.5, 16 / 9, 0.75])[:count]
    return calibration_sheet(images, aspect, TRUTH.at(slice(count)), PREDICTED.at(slice(count)), method="ours")


@pytest.mark.parametrize("make", [an_error_figure, a_scatter, a_coverage_figure, a_sparsification_figure, a_sheet])
def test_figures_are_saved_as_pictures(make, tmp_path):
    (path,) = save_figure(make(), tmp_path, "figure")
    with Image.open(path) as picture:
        assert min(picture.size) > 300
        assert len(np.unique(np.asarray(picture.convert("L")))) > 20


@pytest.mark.parametrize("make", [an_error_figure, a_scatter, a_coverage_figure, a_sparsification_figure, a_sheet])
def test_no_label_covers_another_panel(make):
    figure = make()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = [axes.get_tightbbox(renderer) for axes in figure.axes if axes.axison]
    for i, one in enumerate(boxes):
        assert not any(one.shrunk(0.99, 0.99).overlaps(other.shrunk(0.99, 0.99)) for other in boxes[i + 1 :])


def test_axes_say_what_they_show():
    for make in (an_error_figure, a_scatter, a_coverage_figure, a_sparsification_figure):
        figure = make()
        assert any(axes.get_ylabel() for axes in figure.axes)
        assert figure.axes[-1].get_xlabel()


def test_curves_of_errors_are_medians_of_bins():
    figure = an_error_figure()
    cell = figure.axes[0]  # tilt error against true tilt
    twice, half = cell.get_lines()
    assert (twice.get_label(), half.get_label()) == ("twice", "half")
    np.testing.assert_allclose(twice.get_ydata(), 4 * half.get_ydata())
    outer = [0, 1, -2, -1]  # bins that do not straddle zero: there the median error is that of the median tilt
    np.testing.assert_allclose(twice.get_ydata()[outer], 2 * np.abs(twice.get_xdata()[outer]), rtol=0.1)
    assert cell.get_yscale() == "log"
    silent = figure.axes[4].get_lines()[1]
    assert np.isnan(silent.get_ydata()).all()


@pytest.mark.slow
def test_all_that_is_drawn_lies_within_its_panel():
    figure = an_error_figure()
    figure.draw_without_rendering()
    for cell in figure.axes:
        low, high = cell.get_ylim()
        for line in cell.get_lines():
            values = line.get_ydata()[np.isfinite(line.get_ydata())]
            assert ((values >= low) & (values <= high)).all()


def test_bins_hold_equal_counts_and_failures_are_the_worst():
    values, errors = np.arange(96.0)[::-1], np.arange(96.0)[::-1]
    centres, low, middle, high = binned_quartiles(values, errors)
    np.testing.assert_allclose(centres, 12 * np.arange(8) + 5.5)
    np.testing.assert_allclose(middle, 12 * np.arange(8) + 5)
    assert ((low < middle) & (middle < high)).all()
    errors[:4] = np.nan  # of the largest 12 values
    assert np.isnan(binned_quartiles(values, errors)[3]).tolist() == [False] * 7 + [True]
    assert np.isfinite(binned_quartiles(values, errors)[2]).all()
    assert binned_quartiles(np.arange(5.0), np.arange(5.0)).shape == (4, 1)


def test_dots_are_the_predictions_in_degrees_and_the_rest_is_counted():
    figure = a_scatter()
    dots = figure.axes[0].collections[0].get_offsets()
    np.testing.assert_allclose(dots[:, 0], np.degrees(TRUTH.tilt.numpy()))
    np.testing.assert_allclose(dots[:, 1], np.degrees(0.5 * TRUTH.tilt.numpy()))
    assert figure.axes[0].get_title() == "rank correlation 1.00"
    wild = PREDICTED.tilt.clone()
    wild[0], wild[1] = 9.0, torch.nan
    cell = predicted_against_true(TRUTH, PREDICTED._replace(tilt=wild)).axes[0]
    assert len(cell.collections[0].get_offsets()) == N - 2
    assert "2 not shown" in cell.get_title()
    assert cell.get_xlim()[1] < 60


def test_a_constant_prediction_and_no_prediction_can_be_drawn():
    constant = CameraParameters(*(torch.full_like(v, float(v.median())) for v in TRUTH))
    assert predicted_against_true(TRUTH, constant).axes[2].get_title() == ""
    nothing = CameraParameters(*(torch.full_like(v, torch.nan) for v in TRUTH))
    assert predicted_against_true(TRUTH, nothing).axes[0].get_title() == f"{N} not shown"


def test_coverage_is_drawn_in_percent_against_the_level():
    curve = a_curve()
    diagonal, *lines = coverage_curves(curve, NAMES).axes[0].get_lines()
    np.testing.assert_allclose(diagonal.get_xdata(), diagonal.get_ydata())
    assert [line.get_label() for line in lines] == NAMES
    for line, share in zip(lines, curve.coverage.T, strict=True):
        np.testing.assert_allclose(line.get_xydata(), 100 * np.stack([curve.levels, share], 1))


def test_sparsification_shows_the_curve_above_its_oracle():
    cell = a_sparsification_figure().axes[1]
    curve, oracle, flat = cell.get_lines()
    np.testing.assert_allclose(curve.get_xydata(), np.stack([100 * RESULT.removed, RESULT.curve], 1))
    np.testing.assert_allclose(oracle.get_ydata(), RESULT.oracle)
    assert set(flat.get_ydata()) == {1}
    assert f"AUSE {RESULT.ause:.2f}" in cell.get_title()


def test_the_sheet_has_numbers_under_every_crop():
    figure = a_sheet()
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == 5
    lines = shown[1].get_xlabel().splitlines()
    tilt = math.degrees(TRUTH.tilt[1])
    assert lines[0].split() == ["true", "ours"]
    assert lines[1].split() == ["tilt", f"{tilt:+.1f}°", f"{tilt / 2:+.1f}°"]
    assert [line.split()[0] for line in lines[1:]] == ["tilt", "roll", "vfov", "k1/f²"]
    left, right = shown[3].get_xlim()
    bottom, top = shown[3].get_ylim()
    assert (right - left) / (bottom - top) == pytest.approx(16 / 9, rel=1e-6)
    assert [to_hex(line.get_color()) for line in shown[0].get_lines()] == [COLOURS[5].lower(), COLOURS[4].lower()]


def test_a_sheet_says_when_a_method_gave_nothing():
    images = torch.zeros(1, 3, 8, 8, dtype=torch.uint8)
    nothing = CameraParameters(*(torch.full((1,), torch.nan, dtype=torch.float64) for _ in range(4)))
    figure = calibration_sheet(images, torch.ones(1), TRUTH.at(slice(1)), nothing)
    assert [line.split()[-1] for line in figure.axes[0].get_xlabel().splitlines()[1:]] == ["–"] * 4
    assert np.isnan(figure.axes[0].get_lines()[1].get_ydata()).all()
