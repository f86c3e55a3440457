"""Figures of calibration errors: by parameter, against the truth, coverage and sparsification."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, StrMethodFormatter
from numpy import ndarray
from scipy import stats
from torch import rad2deg

from sextant.chapters.calibration.metrics.sparsification import Sparsification
from sextant.evaluation.conformal import CoverageCurve
from sextant.figures.style import COLOURS, new_figure, plain
from sextant.geometry import CameraParameters, vfov_from_focal

#: quantities of a camera with their axis labels
QUANTITIES = {"tilt": "tilt (°)", "roll": "roll (°)", "vfov": "vertical field of view (°)", "k1_hat": "k1 / f²"}
#: errors with their axis labels
ERROR_LABELS = {
    "tilt_deg": "tilt error (°)",
    "roll_deg": "roll error (°)",
    "vfov_deg": "vfov error (°)",
    "true_vfov_deg": "true vfov error (°)",
    "focal_percent": "focal error (%)",
    "k1": "k1 error",
    "k1_hat": "k1 / f² error",
    "bearing_deg": "bearing error (°)",
    "undistortion_px": "undistortion error\n(px of 480)",
}


def camera_quantities(camera: CameraParameters) -> dict[str, Float[ndarray, "n"]]:
    """Tilt, roll and nominal vertical field of view in degrees, and apparent distortion.

    >>> import torch
    >>> tilt, roll, focal, k1 = torch.tensor([[0.1], [0.0], [0.5], [-0.05]])
    >>> found = camera_quantities(CameraParameters(tilt, roll, focal, k1))
    >>> {name: float(values[0].round(2)) for name, values in found.items()}
    {'tilt': 5.73, 'roll': 0.0, 'vfov': 90.0, 'k1_hat': -0.2}
    """
    values = {
        "tilt": rad2deg(camera.tilt),
        "roll": rad2deg(camera.roll),
        "vfov": rad2deg(vfov_from_focal(camera.focal)),
        "k1_hat": camera.k1 / camera.focal.square(),
    }
    return {name: tensor.detach().cpu().double().numpy() for name, tensor in values.items()}


BINS, LEAST = 8, 12  # bins along a parameter, and fewest images in one
MARKERS = "os^Dv*P"
SHOWN = ("tilt_deg", "vfov_deg", "bearing_deg")


def error_by_parameter(
    truth: CameraParameters,
    errors: Mapping[str, Mapping[str, Float[ndarray, "n"]]],
    shown: Sequence[str] = SHOWN,
) -> Figure:
    """One row per error, one column per true parameter, one curve per method: medians of bins with a quartile band.

    Bins hold equal numbers of images; a curve's points are at the median parameter of each. Errors are on a logarithmic
    scale. An image without an estimate counts as an infinite error: a curve ends where half of the images have none,
    and its band where a quarter have none.

    Args:
        truth: the true cameras.
        errors: absolute, by method, then by name.
        shown: names of the errors.

    Example:
        >>> import torch
        >>> truth = CameraParameters(*torch.linspace(0.1, 0.5, 24).expand(4, 24))
        >>> figure = error_by_parameter(truth, {"ours": {"tilt_deg": np.arange(1.0, 25)}}, ["tilt_deg"])
        >>> [axes.get_xlabel() for axes in figure.axes]
        ['true tilt (°)', 'true roll (°)', 'true vertical field of view (°)', 'true k1 / f²']
        >>> figure.axes[0].lines[0].get_ydata()  # medians of two bins of twelve
        array([ 6., 18.])
    """
    columns = camera_quantities(truth)
    figure, axes = new_figure(3.1 * len(columns), 2.3 * len(shown) + 0.5, rows=len(shown), columns=len(columns))
    for row, error in enumerate(shown):
        cells = axes[row * len(columns) : (row + 1) * len(columns)]
        for cell in cells[1:]:
            cell.sharey(cells[0])
            cell.tick_params(labelleft=False)
        for cell, (quantity, values) in zip(cells, columns.items(), strict=True):
            for colour, marker, (method, by_name) in zip(COLOURS * 3, MARKERS * 3, errors.items(), strict=False):
                centres, low, middle, high = binned_quartiles(values, by_name[error])
                cell.plot(centres, middle, marker=marker, color=colour, label=method, markersize=4, linewidth=1.4)
                cell.fill_between(centres, low, high, color=colour, alpha=0.12, linewidth=0)
            cell.set_yscale("log")
            cell.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            cell.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            cell.yaxis.set_minor_locator(LogLocator(subs=()))
            if row == len(shown) - 1:
                cell.set_xlabel(f"true {QUANTITIES[quantity]}")
            plain(cell)
        cells[0].set_ylabel(ERROR_LABELS[error])
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 7), frameon=False, fontsize=9)
    return figure


def binned_quartiles(values: Float[ndarray, "n"], errors: Float[ndarray, "n"]) -> Float[ndarray, "4 bins"]:
    """For bins of equal counts: median value, and lower quartile, median and upper quartile of the errors.

    Nan counts as an infinite error; infinite results are returned as nan, which matplotlib leaves out.

    >>> binned_quartiles(np.arange(24.0), np.arange(24.0))[2]  # medians of two bins of twelve
    array([ 5., 17.])
    """
    order = np.argsort(values, kind="stable")
    known = np.where(np.isnan(errors), np.inf, errors)
    columns = [
        (np.median(values[chosen]), *np.quantile(known[chosen], (0.25, 0.5, 0.75), method="inverted_cdf"))
        for chosen in np.array_split(order, max(1, min(BINS, len(order) // LEAST)))
    ]
    quartiles = np.array(columns, float).T
    return np.where(np.isinf(quartiles), np.nan, quartiles)


ROOM = 0.35  # margin of a panel beyond the true values, as a share of their range


def predicted_against_true(truth: CameraParameters, predicted: CameraParameters) -> Figure:
    """One panel per parameter, one dot per image, and the diagonal where both agree.

    A panel extends only slightly beyond the true values, so that outliers do not compress the others. Its title gives
    the number of images not shown, including those without an estimate. The rank correlation is Spearman's, over the
    images with one.

    >>> import torch
    >>> truth = CameraParameters(*torch.linspace(0.1, 0.5, 9).expand(4, 9))
    >>> figure = predicted_against_true(truth, truth._replace(tilt=2 * truth.tilt))
    >>> figure.axes[0].get_title(), figure.axes[0].get_ylabel()
    ('rank correlation 1.00, 4 not shown', 'predicted tilt (°)')
    """
    panels = [(camera_quantities(truth)[name], values) for name, values in camera_quantities(predicted).items()]
    figure, axes = new_figure(3.1 * len(panels), 3.2, columns=len(panels))
    for cell, (true, found), label in zip(axes, panels, QUANTITIES.values(), strict=True):
        known = np.isfinite(found)
        both = np.stack([true[known], found[known]])
        room = ROOM * max(float(np.ptp(true)), 1e-6)
        low, high = (
            max(both.min(initial=true.min()), true.min() - room),
            min(both.max(initial=true.max()), true.max() + room),
        )
        margin = 0.03 * max(high - low, 1e-6)
        limits = (low - margin, high + margin)
        inside = ((both >= limits[0]) & (both <= limits[1])).all(0)
        alpha = float(np.clip(250 / max(len(true), 1), 0.12, 0.7))
        x, y = both[:, inside]
        cell.scatter(x, y, s=9, color=COLOURS[0], alpha=alpha, linewidths=0, rasterized=True)
        cell.plot(limits, limits, color="black", linewidth=0.9)
        cell.set(xlim=limits, ylim=limits, xlabel=f"true {label}", ylabel=f"predicted {label}", aspect="equal")
        cell.set_title(_title(true[known], found[known], len(true) - int(inside.sum())), fontsize=9)
        cell.locator_params(nbins=5)
        plain(cell)
    return figure


def _title(true: Float[ndarray, "n"], found: Float[ndarray, "n"], missing: int) -> str:
    varied = len(true) > 1 and np.ptp(true) > 0 and np.ptp(found) > 0
    parts = [f"rank correlation {stats.spearmanr(true, found).statistic:.2f}"] if varied else []
    return ", ".join([*parts, *([f"{missing} not shown"] if missing else [])])


def coverage_curves(curve: CoverageCurve, names: Sequence[str]) -> Figure:
    """One curve per parameter with its 95 % band over panoramas; below the diagonal intervals are too short.

    Args:
        curve: coverage of k parameters.
        names: names of the k parameters.

    Example:
        >>> import numpy as np
        >>> levels, share = np.array([0.5, 0.9]), np.array([[0.4], [0.85]])
        >>> curve = CoverageCurve(levels, share, share - 0.1, share + 0.1, multipliers=np.ones((2, 1)))
        >>> _, line = coverage_curves(curve, ["tilt"]).axes[0].lines  # the first is the diagonal
        >>> line.get_ydata()
        array([40., 85.])
    """
    figure, (axes,) = new_figure(4.6, 4.4)
    axes.plot([0, 100], [0, 100], color="black", linewidth=0.9, label="nominal")
    for colour, name, share, low, high in zip(
        COLOURS, names, curve.coverage.T, curve.low.T, curve.high.T, strict=False
    ):
        axes.plot(100 * curve.levels, 100 * share, "o-", color=colour, label=name, markersize=3, linewidth=1.4)
        axes.fill_between(100 * curve.levels, 100 * low, 100 * high, color=colour, alpha=0.13, linewidth=0)
    axes.set(xlim=(0, 100), ylim=(0, 100), aspect="equal")
    axes.set(xlabel="level of the intervals (%)", ylabel="test images whose interval covers the truth (%)")
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    plain(axes)
    return figure


def sparsification_curves(results: Mapping[str, Sparsification]) -> Figure:
    """One panel per parameter: mean error of the remaining images as the most uncertain are removed.

    The area between the curve and the oracle's is shaded; the titles give it as a share of the area for random order.

    >>> import numpy as np
    >>> from sextant.chapters.calibration.metrics.sparsification import sparsification
    >>> figure = sparsification_curves({"tilt": sparsification(np.array([1.0, 2, 3, 4]), np.array([1.0, 2, 4, 3]))})
    >>> figure.axes[0].get_title().splitlines()
    ['tilt', 'AUSE 0.03 (0.11 of random), Spearman 0.80']
    """
    figure, axes = new_figure(3.0 * len(results), 3.3, columns=len(results))
    for cell, (name, result) in zip(axes, results.items(), strict=True):
        share = 100 * result.removed
        cell.fill_between(share, result.oracle, result.curve, color=COLOURS[0], alpha=0.13, linewidth=0)
        cell.plot(share, result.curve, color=COLOURS[0], label="by predicted uncertainty")
        cell.plot(share, result.oracle, color=COLOURS[2], linestyle="--", label="by error itself (oracle)")
        cell.axhline(1, color="0.4", linestyle=":", label="in random order")
        said = f"{name}\nAUSE {result.ause:.2f} ({result.relative:.2f} of random), Spearman {result.spearman:.2f}"
        cell.set_title(said, fontsize=8)
        cell.set(xlim=(0, 100), xlabel="images removed (%)")
        cell.set_ylim(0, max(1.15, min(2.0, 1.05 * float(result.curve.max()))))
        plain(cell)
    axes[0].set_ylabel("mean error of the rest / of all")
    handles, labels = axes[0].get_legend_handles_labels()
    columns = 3 if len(results) > 1 else 1
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return figure
