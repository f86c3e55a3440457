"""Errors of the variants of networks against what they cost."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from sextant.figures.style import COLOURS, new_figure, plain

#: costs that are marked on the axis
TICKS = (1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20)
#: ratio of costs below which the names of two variants would overlap
NEAR = 1.2


@dataclass(frozen=True)
class CostPoint:
    """One variant of a network.

    Attributes:
        name: of the variant.
        cost: relative to the variant it is compared with, whose own is 1.
        value, low, high: its error and the ends of the interval, nan if there is none.
        certain: whether its difference from that variant is certain.
    """

    name: str
    cost: float
    value: float
    low: float
    high: float
    certain: bool = False


def error_against_cost(
    panels: Mapping[tuple[str, str], Sequence[CostPoint]], *, cost: str, quantity: str, told: str = ""
) -> Figure:
    """One column per network and one row per condition; filled points differ for certain from the first one.

    A dashed line marks the error of the first variant, so that what lies below it is better.

    Args:
        panels: the variants by condition and network, the reference first.
        cost: name of the horizontal axis, which is logarithmic.
        quantity: name of the vertical axis.
        told: note below the figure.

    Raises:
        ValueError: there is nothing to draw.

    Example:
        >>> points = [CostPoint("none", 1, 10, 9, 11), CostPoint("first", 2.4, 8, 7, 9, certain=True)]
        >>> figure = error_against_cost({("clean", "LeNet"): points}, cost="cost", quantity="error (%)")
        >>> figure.axes[0].get_title(), [text.get_text() for text in figure.axes[0].texts]
        ('LeNet', ['none', 'first'])
    """
    conditions, networks = (list(dict.fromkeys(key[place] for key in panels)) for place in (0, 1))
    if not panels:
        raise ValueError("the figure needs at least one network under one condition")
    figure, axes = new_figure(3.6 * len(networks) + 0.6, 2.1 * len(conditions) + 0.6, len(conditions), len(networks))
    for row, condition in enumerate(conditions):
        for column, network in enumerate(networks):
            one = axes[row * len(networks) + column]
            _draw(one, panels.get((condition, network), ()), COLOURS[row % len(COLOURS)])
            one.set_title(network.replace("_", " ") if row == 0 else "", fontsize=10)
            one.set_xlabel(cost if row == len(conditions) - 1 else "", fontsize=9)
            one.set_ylabel(f"{condition}\n{quantity}" if column == 0 else "", fontsize=9)
    figure.text(0.5, -0.01, told, ha="center", va="top", fontsize=8)
    return figure


def _draw(axes: Axes, points: Sequence[CostPoint], colour: str) -> None:
    plain(axes)
    axes.set_xscale("log")
    axes.margins(x=0.18, y=0.3)
    for number, point in enumerate(points):
        if number == 0:
            axes.axhline(point.value, color="0.5", linestyle="--", linewidth=0.9)
        low, high = (end if end == end else point.value for end in (point.low, point.high))
        axes.errorbar(
            point.cost,
            point.value,
            [[point.value - low], [high - point.value]],
            fmt="o",
            color=colour,
            markerfacecolor=colour if point.certain else "white",
            capsize=3,
        )
        above = number == 0 or point.cost / points[number - 1].cost > NEAR  # else below the bar
        axes.annotate(
            point.name.replace("_", " "),
            (point.cost, high if above else low),
            (0, 3 if above else -3),
            textcoords="offset points",
            ha="center",
            va="bottom" if above else "top",
            fontsize=8,
        )
    most = max((point.cost for point in points), default=1.0)
    axes.set_xticks([tick for tick in TICKS if tick <= 1.2 * most], minor=False)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}×")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.tick_params(labelsize=8)
    axes.set_ylim(bottom=max(0.0, axes.get_ylim()[0]))
