"""Effects over a grid of two factors."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import new_figure


def effect_map(
    panels: Mapping[str, Float[ndarray, "rows columns"]],
    texts: Mapping[str, Sequence[Sequence[str]]],
    *,
    rows: Sequence[str],
    columns: Sequence[str],
    factor: str,
    better: str,
    quantity: str,
) -> Figure:
    """One map per condition: blue where an effect is for the better, red where for the worse, white at none.

    Args:
        panels: effects by condition; nan where nothing was measured. Each panel has its own range of colours.
        texts: what is written into the cells.
        rows, columns: their names.
        factor: name of the factor that varies over columns.
        better: whether ``higher`` or ``lower`` is better.
        quantity: the effect, with its unit.

    Raises:
        ValueError: there is nothing to draw.

    Example:
        >>> figure = effect_map(
        ...     {"clean": np.array([[0.1, -0.3]])},
        ...     {"clean": [["+0.1", "-0.3"]]},
        ...     rows=["alpha 1"],
        ...     columns=["1", "2"],
        ...     factor="h",
        ...     better="lower",
        ...     quantity="difference in error (points)",
        ... )
        >>> [text.get_text() for text in figure.axes[0].texts], figure.axes[0].images[0].get_clim()
        (['+0.1', '-0.3'], (-0.3, 0.3))
    """
    if not panels:
        raise ValueError("the figure needs at least one condition")
    colours = "RdBu_r" if better == "lower" else "RdBu"
    figure, axes = new_figure(1.25 * len(columns) + 1.2, (0.55 * len(rows) + 0.55) * len(panels) + 0.4, len(panels))
    for one, (condition, effects) in zip(axes, panels.items(), strict=True):
        reach = float(np.nanmax(np.abs(effects), initial=0.0)) or 1.0
        one.imshow(effects, cmap=colours, vmin=-reach, vmax=reach, aspect="auto")
        for (row, column), value in np.ndenumerate(effects):
            colour = "white" if abs(value) > 0.6 * reach else "black"
            one.text(column, row, texts[condition][row][column], ha="center", va="center", color=colour, fontsize=7.5)
        one.set_title(condition, fontsize=9.5)
        one.set_xticks(range(len(columns)), columns, fontsize=8)
        one.set_yticks(range(len(rows)), [row.replace("_", " ") for row in rows], fontsize=8)
        one.tick_params(length=0)
        one.spines[:].set_visible(False)
    axes[-1].set_xlabel(factor, fontsize=9)
    figure.text(0.5, -0.01, f"{quantity}; {better} is better", ha="center", va="top", fontsize=8)
    return figure
