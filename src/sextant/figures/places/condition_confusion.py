"""How well places are recognised between each pair of conditions."""

import numpy as np
from matplotlib.figure import Figure

from sextant.evaluation.places.condition_recall import ConditionRecall
from sextant.figures.style import new_figure


def condition_confusion(result: ConditionRecall, title: str = "recall@1 (%)") -> Figure:
    """Query conditions by row and reference conditions by column; empty cells have no images.

    The title gives the mean over pairs of different conditions.

    >>> counts = np.full((2, 2), 10)
    >>> recall = ConditionRecall(("day", "night"), np.array([[1.0, 0.4], [0.3, 1.0]]), counts, 0 * counts)
    >>> condition_confusion(recall).axes[0].get_title().splitlines()
    ['recall@1 (%)', 'mean between two conditions 35.0']
    """
    size = len(result.conditions)
    figure, (axes,) = new_figure(0.7 * size + 2.3, 0.55 * size + 1.8)
    axes.imshow(np.ma.masked_invalid(result.recall), cmap="viridis", vmin=0, vmax=1, aspect="auto")
    axes.set_facecolor("0.9")
    for (row, column), value in np.ndenumerate(result.recall):
        if not np.isnan(value):
            colour = "black" if value > 0.6 else "white"
            axes.text(column, row, f"{100 * value:.0f}", ha="center", va="center", color=colour, fontsize=8)
    names = [name.replace("_", " ") for name in result.conditions]
    axes.set_xticks(range(size), names, rotation=35, ha="right", fontsize=8)
    axes.set_yticks(range(size), names, fontsize=8)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set(xlabel="references", ylabel="queries")
    across = "" if np.isnan(result.across) else f"\nmean between two conditions {100 * result.across:.1f}"
    axes.set_title(title + across, fontsize=9)
    return figure
