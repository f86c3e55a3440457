"""Precision against recall of one or several methods."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from sextant.evaluation.places.precision_recall import PrecisionRecall
from sextant.figures.style import COLOURS, new_figure, plain

#: dashes that tell apart methods of the same colour
DASHES = ("-", "--", ":")


def precision_recall_curves(curves: Mapping[str, PrecisionRecall], title: str = "") -> Figure:
    """One curve per method, the best area first in the legend; a dot marks the largest recall at precision 1.

    Args:
        curves: by the method's name.
        title: such as the protocol.

    Raises:
        ValueError: there is no curve.

    Example:
        >>> from sextant.evaluation.places.precision_recall import precision_recall
        >>> curve = precision_recall(np.array([0.9, 0.8, 0.7]), np.array([True, True, False]), positives=2)
        >>> precision_recall_curves({"HOG": curve}).axes[0].get_legend().get_texts()[0].get_text()
        'HOG  1.000'
    """
    if not curves:
        raise ValueError("the figure needs at least one curve")
    figure, (axes,) = new_figure(5.4, 4.2)
    ranked = sorted(curves.items(), key=lambda item: -np.nan_to_num(item[1].auc, nan=-1.0))
    for number, (name, curve) in enumerate(ranked):
        colour, dash = COLOURS[number % len(COLOURS)], DASHES[number // len(COLOURS) % len(DASHES)]
        label = f"{name}  {curve.auc:.3f}"
        axes.plot(100 * curve.recall, 100 * curve.precision, dash, color=colour, lw=1.4, label=label)
        sure = curve.recall_at_precision(1)
        if sure > 0:
            axes.plot(100 * sure, 100, "o", color=colour, markersize=4, clip_on=False, zorder=3)
    axes.set(xlim=(0, 100), ylim=(0, 102), xlabel="recall (% of the queries that have a match)", ylabel="precision (%)")
    axes.set_title(title, fontsize=9)
    plain(axes)
    axes.legend(title="area under the curve", frameon=False, fontsize=8, title_fontsize=8)
    return figure
