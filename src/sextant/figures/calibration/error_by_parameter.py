"""Errors against each true parameter, which show for which cameras a method fails."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, StrMethodFormatter
from numpy import ndarray

from sextant.figures.calibration.quantities import ERROR_LABELS, QUANTITIES, camera_quantities
from sextant.figures.style import COLOURS, new_figure, plain
from sextant.geometry import CameraParameters

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
    scale. An image without an answer counts as an infinite error: a curve breaks off where half of the images have
    none, and its band where a quarter have none.

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
