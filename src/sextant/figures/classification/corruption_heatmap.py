"""Error of one model by corruption and severity."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from sextant.figures.classification.corruption_families import by_family, name_family
from sextant.figures.style import new_figure


def corruption_heatmap(
    errors: Mapping[str, Sequence[float]],
    *,
    clean: float | None = None,
    families: Mapping[str, Sequence[str]] | None = None,
    levels: Sequence[str] | None = None,
    title: str = "",
    highest: float = 1.0,
    label: str = "severity, error (%)",
    mean: bool = True,
) -> Figure:
    """One row per corruption, one column per severity, and the mean over several severities beside; cells in per cent.

    Args:
        errors: shares of wrong predictions by corruption, mildest severity first; rows may differ in length.
        clean: error on clean images, given below the title.
        families: groups of corruptions, named on the right and separated by lines; those in no group come last.
        levels: names of the severities; 1, 2, ... by default.
        title: name of the model.
        label: what the columns are.
        mean: whether to add the mean of the columns, if there are several.
        highest: error at the dark end of the colour scale; 1 in all figures makes models comparable.

    Raises:
        ValueError: there is nothing to draw.

    Example:
        >>> axes = corruption_heatmap({"fog": [0.1, 0.3], "snow": [0.2, 0.6]}, clean=0.05, title="LeNet").axes[0]
        >>> axes.images[0].get_array().data.round(2)  # the last column is the mean
        array([[0.1, 0.3, 0.2],
               [0.2, 0.6, 0.4]])
        >>> axes.get_title().splitlines()
        ['LeNet', 'clean 5.00 %, mean 30.00 %']
    """
    columns = max((len(values) for values in errors.values()), default=0)
    if columns == 0:
        raise ValueError("a heat map needs at least one corruption with a severity")
    groups = by_family(errors, families or {})
    names = [name for _, members in groups for name in members]
    means = np.array([np.mean(errors[name]) for name in names])
    table = np.full((len(names), columns), np.nan)
    for row, name in enumerate(names):
        table[row, : len(errors[name])] = errors[name]
    names_of_levels = list(levels) if levels is not None else [str(i + 1) for i in range(columns)]
    if mean and columns > 1:  # the mean of a single severity would only repeat it
        table, names_of_levels = np.column_stack([table, means]), [*names_of_levels, "mean"]
    figure, (axes,) = new_figure(0.62 * table.shape[1] + 2.6, 0.27 * len(names) + 1.3)
    axes.imshow(table, cmap="YlOrRd", vmin=0, vmax=highest, aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        if not np.isnan(value):
            colour = "white" if value > 0.62 * highest else "black"
            weight = "bold" if mean and column == columns else "normal"
            axes.text(
                column, row, f"{100 * value:.1f}", ha="center", va="center", color=colour, fontsize=7, fontweight=weight
            )
    axes.axvline(columns - 0.5, color="white", lw=4)
    axes.set_xticks(range(table.shape[1]), names_of_levels, fontsize=8)
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names], fontsize=8)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    start = 0
    for family, members in groups:
        if start:
            axes.axhline(start - 0.5, color="white", lw=4)
        name_family(axes, family, start + (len(members) - 1) / 2)
        start += len(members)
    told = "" if clean is None else f"\nclean {100 * clean:.2f} %, mean {100 * means.mean():.2f} %"
    axes.set_title(f"{title}{told}".strip(), fontsize=9)
    axes.set_xlabel(label, fontsize=8)
    return figure
