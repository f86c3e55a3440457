"""Accuracy against the number of examples a class that a method has learnt from."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Integer
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import COLOURS, new_figure, plain


def few_shot_curves(
    examples: Integer[ndarray, " k"],
    accuracy: Mapping[str, Float[ndarray, " k"]],
    intervals: Mapping[str, tuple[Float[ndarray, " k"], Float[ndarray, " k"]]] | None = None,
    *,
    title: str = "",
    quantity: str = "accuracy",
) -> Figure:
    """One line a method with its intervals, best first in the legend by the last number.

    Args:
        examples: for each class, ascending, above 0.
        accuracy: by method, in [0, 1]; nan where a method was not tried.
        intervals: ends of each accuracy's interval by method; methods may be left out.
        title: such as the dataset.
        quantity: what is on the other axis.

    Raises:
        ValueError: there is no method, or examples do not ascend from above 0.
    """
    if not accuracy:
        raise ValueError("the figure needs at least one method")
    if len(examples) == 0 or examples[0] < 1 or (np.diff(examples) <= 0).any():
        raise ValueError(f"numbers of examples must ascend from above 0, got {examples.tolist()}")
    figure, (axes,) = new_figure(5.6, 3.8)
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(accuracy)}
    for name in sorted(accuracy, key=lambda name: _last(accuracy[name]), reverse=True):
        values, colour = accuracy[name], colours[name]
        there = ~np.isnan(values)
        axes.plot(examples[there], 100 * values[there], "o-", color=colour, markersize=4, linewidth=1.3, label=name)
        if intervals and name in intervals:
            low, high = (100 * end[there] for end in intervals[name])
            axes.fill_between(examples[there], low, high, color=colour, alpha=0.15, linewidth=0)
    axes.set_xscale("log")
    axes.set_xticks(examples, [f"{count:,}" for count in examples])
    axes.minorticks_off()
    axes.set(xlabel="examples a class", ylabel=f"{quantity} (%)")
    axes.set_title(title, fontsize=9)
    plain(axes)
    axes.legend(frameon=False, fontsize=8, loc="best")
    return figure


def _last(values: Float[ndarray, " k"]) -> float:
    """The accuracy with the most examples that a method was tried with."""
    there = values[~np.isnan(values)]
    return float(there[-1]) if len(there) else -1.0
