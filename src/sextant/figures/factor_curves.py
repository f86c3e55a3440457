"""A measure against a factor of an experiment, such as examples per class, filters, or a learning rate."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import COLOURS, new_figure, plain

#: the factor's axis is logarithmic if the ratio of its largest to its smallest value is at least this
DECADE = 10
LINES = ("-", "--", ":")
#: margin above and below the lines, as a share of their range; intervals are cut off there
ROOM = 0.15
COLUMNS = 3


@dataclass(frozen=True)
class FactorCurve:
    """A measure of one arm at each value of the factor; nan where it was not run.

    Attributes:
        values: in the unit of the measure.
        low, high: ends of their intervals; nan if there is none.
    """

    values: Float[ndarray, " k"]
    low: Float[ndarray, " k"]
    high: Float[ndarray, " k"]


def factor_curves(
    factor: str,
    levels: Float[ndarray, " k"],
    panels: Mapping[str, Mapping[str, FactorCurve]],
    *,
    quantity: str,
    title: str = "",
) -> Figure:
    """One panel per condition, one line per arm with its intervals.

    In the legend, the line that ends highest in the first panel comes first.

    Args:
        factor: name of the horizontal axis, which is logarithmic if values are far apart and none is below 0.
        levels: its values, ascending.
        panels: curves by condition, then by arm; the same arms in each.
        quantity: what is measured, with its unit.
        title: of the whole figure, such as the values of the other factors.

    Raises:
        ValueError: there is no curve, or levels do not ascend.

    Example:
        >>> curve = FactorCurve(np.array([70.0, 90.0]), np.array([65.0, 88.0]), np.array([75.0, 92.0]))
        >>> figure = factor_curves("examples", np.array([1.0, 10.0]), {"test": {"svm": curve}}, quantity="accuracy (%)")
        >>> figure.axes[0].get_xlabel(), figure.axes[0].get_xscale()
        ('examples', 'log')
    """
    if not any(panels.values()):
        raise ValueError("the figure needs at least one curve")
    if len(levels) == 0 or (np.diff(levels) <= 0).any():
        raise ValueError(f"values of {factor} must ascend, got {levels.tolist()}")
    columns = min(COLUMNS, len(panels))
    figure, axes = new_figure(
        1.6 + 4.2 * columns, 3.8 * math.ceil(len(panels) / columns), -(-len(panels) // columns), columns
    )
    arms = list(dict.fromkeys(arm for curves in panels.values() for arm in curves))
    for one, (condition, curves) in zip(axes, panels.items(), strict=False):
        _draw(one, levels, curves, arms)
        one.set(xlabel=factor, ylabel=quantity)
        one.set_title(condition if len(panels) > 1 else "", fontsize=9)
    for unused in axes[len(panels) :]:
        unused.remove()
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, frameon=False, fontsize=8, loc="outside right center")
    figure.suptitle(title, fontsize=9)
    return figure


def _draw(axes: Axes, levels: Float[ndarray, " k"], curves: Mapping[str, FactorCurve], arms: Sequence[str]) -> None:
    for arm in sorted(curves, key=lambda arm: _last(curves[arm]), reverse=True):
        curve, place = curves[arm], arms.index(arm)
        colour, line = COLOURS[place % len(COLOURS)], LINES[place // len(COLOURS) % len(LINES)]
        axes.plot(levels, curve.values, line, marker="o", markersize=4, color=colour, label=arm)
        axes.fill_between(levels, curve.low, curve.high, color=colour, alpha=0.15, linewidth=0)
    values = np.concatenate([curve.values for curve in curves.values()])
    if np.isfinite(values).any():  # intervals of two or three seeds may be wider than the range of the lines
        least, most = np.nanmin(values), np.nanmax(values)
        margin = ROOM * (most - least) or 1.0
        axes.set_ylim(least - margin, most + margin)
    positive = levels[levels > 0]
    if levels[0] >= 0 and positive[-1] >= DECADE * positive[0]:
        if len(positive) == len(levels):
            axes.set_xscale("log")
        else:
            axes.set_xscale("symlog", linthresh=positive[0])
        axes.minorticks_off()
    axes.set_xticks(levels, [f"{level:,g}" for level in levels])
    plain(axes)


def _last(curve: FactorCurve) -> float:
    """The measure at the largest value of the factor with which the arm was run."""
    there = curve.values[~np.isnan(curve.values)]
    return float(there[-1]) if len(there) else -math.inf
