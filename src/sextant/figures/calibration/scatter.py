"""Predicted against true parameters."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from numpy import ndarray
from scipy import stats

from sextant.figures.calibration.quantities import QUANTITIES, camera_quantities
from sextant.figures.style import COLOURS, new_figure, plain
from sextant.geometry import CameraParameters

ROOM = 0.35  # how far panels go beyond the true values, as a share of their range


def predicted_against_true(truth: CameraParameters, predicted: CameraParameters) -> Figure:
    """One panel per parameter, one dot per image, and the diagonal where both agree.

    A panel reaches only somewhat beyond the true values, so that a few predictions do not squeeze all others. Its title
    gives the number of images not shown, including those without an answer. The rank correlation is Spearman's, over
    the images with an answer.

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
