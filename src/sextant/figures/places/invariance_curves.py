"""Recall against one appearance factor at a time."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from sextant.evaluation.places.condition_recall import FactorRecall
from sextant.figures.style import COLOURS, new_figure, plain

COLUMNS = 4


def invariance_curves(
    factors: Mapping[str, Mapping[str, FactorRecall]],
    reference: Mapping[str, float] | None = None,
    metric: str = "recall@1",
    *,
    title: str = "",
) -> Figure:
    """One panel per factor, one curve per method with its 95 % interval as a band.

    Args:
        factors: by the factor's name (with its unit), then by method.
        reference: value of a factor in the reference images, marked by a vertical line.
        metric: name of the vertical axis.
        title: above all panels, such as the protocol.

    Raises:
        ValueError: there is no factor.

    Example:
        >>> import numpy as np
        >>> from sextant.evaluation.places.condition_recall import factor_recall
        >>> fog = factor_recall(np.array([True, True, True, False]), np.array([0.0, 0.0, 0.5, 0.5]))
        >>> figure = invariance_curves({"fog": {"pixels": fog}}, reference={"fog": 0.0})
        >>> figure.axes[0].lines[0].get_xydata().tolist()
        [[0.0, 100.0], [0.5, 50.0]]
    """
    if not factors:
        raise ValueError("the figure needs at least one factor")
    methods = list(dict.fromkeys(method for curves in factors.values() for method in curves))
    columns = min(COLUMNS, len(factors))
    rows = -(-len(factors) // columns)
    figure, panels = new_figure(3.0 * columns, 2.7 * rows + 0.4, rows=rows, columns=columns)
    for axes in panels[len(factors) :]:
        axes.axis("off")
    for number, (axes, (factor, curves)) in enumerate(zip(panels, factors.items(), strict=False)):
        for method, curve in curves.items():
            colour = COLOURS[methods.index(method) % len(COLOURS)]
            axes.plot(curve.values, 100 * curve.recall, "o-", color=colour, markersize=3.5, lw=1.3)
            axes.fill_between(curve.values, 100 * curve.low, 100 * curve.high, color=colour, alpha=0.15, lw=0)
        if reference and factor in reference:
            axes.axvline(reference[factor], color="0.4", ls=":", lw=1)
        axes.set(ylim=(0, 101), xlabel=factor.replace("_", " "))
        if number % columns == 0:
            axes.set_ylabel(f"{metric} (%)")
        plain(axes)
    handles = [
        panels[0].plot([], [], "o-", color=COLOURS[number % len(COLOURS)], markersize=3.5, label=method)[0]
        for number, method in enumerate(methods)
    ]
    if reference and not reference.keys().isdisjoint(factors):
        handles += panels[0].plot([], [], ":", color="0.4", label="in the reference images")
    if title:
        figure.suptitle(title, fontsize=10)
    columns_of_legend = max(1, min(len(handles), 2 * columns))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns_of_legend, frameon=False, fontsize=8)
    return figure
