"""Effects of arms: contrasts with intervals, over two factors, and against cost."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from numpy import ndarray

from sextant.figures.style import COLOURS, new_figure, plain


@dataclass(frozen=True)
class ForestRow:
    """One difference: its mean and interval, the noise floor's interval, and the published value; nan if missing."""

    label: str
    mean: float
    low: float
    high: float
    floor_low: float
    floor_high: float
    published: float


def contrast_forest(panels: Sequence[tuple[str, Sequence[ForestRow]]], xlabel: str, replicate: str = "seeds") -> Figure:
    """One panel per setting, one row per condition.

    The grey band is the range in which a *single* pair of runs of the same network falls 95 times in 100: differences
    inside it are not evidence when based on one run each.

    >>> row = ForestRow("fog", mean=1.2, low=0.8, high=1.6, floor_low=-0.5, floor_high=0.5, published=float("nan"))
    >>> figure = contrast_forest([("LeNet", [row]), ("ResNet", [row])], "points of accuracy")
    >>> [axes.get_title() for axes in figure.axes]
    ['LeNet', 'ResNet']
    """
    rows = max(len(entries) for _, entries in panels)
    figure, axes = new_figure(3.6 * len(panels) + 1, 0.34 * rows + 1.4, columns=len(panels))
    for number, (panel, (title, entries)) in enumerate(zip(axes, panels, strict=True)):
        for row, entry in enumerate(entries):
            panel.fill_betweenx([row - 0.4, row + 0.4], entry.floor_low, entry.floor_high, color="0.85", lw=0)
            panel.plot([entry.low, entry.high], [row, row], color=COLOURS[0], lw=2)
            panel.plot(entry.mean, row, "o", color=COLOURS[0], markersize=5)
            panel.plot(entry.published, row, "D", color=COLOURS[1], markersize=4)
        panel.axvline(0, color="black", lw=0.8)
        panel.set_ylim(rows - 0.5, -0.5)
        panel.set_yticks(range(len(entries)), [e.label if number == 0 else "" for e in entries], fontsize=8)
        panel.set(title=title, xlabel=xlabel)
        plain(panel)
    shown = [entry for _, entries in panels for entry in entries]
    mean = f"mean over {replicate}, 95 % interval"
    handles: list[Artist] = [*axes[0].plot([], [], "o-", color=COLOURS[0], label=mean)]
    if any(entry.floor_low == entry.floor_low for entry in shown):
        handles.append(axes[0].fill_betweenx([], [], [], color="0.85", label="one pair of runs, seeds alone (95 %)"))
    if any(entry.published == entry.published for entry in shown):
        published = axes[0].plot([], [], "D", color=COLOURS[1], linestyle="none", label="published, one run each")
        handles += published
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


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


#: costs that are marked on the axis
TICKS = (1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20)
#: ratio of costs below which names of variants would overlap: the highest one's stands above their bars, others below
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


def _ends(point: CostPoint) -> tuple[float, float]:
    low, high = (end if end == end else point.value for end in (point.low, point.high))
    return low, high


def _ratio(one: float, other: float) -> float:
    return max(one, other) / min(one, other)


def _draw(axes: Axes, points: Sequence[CostPoint], colour: str) -> None:
    plain(axes)
    axes.set_xscale("log")
    axes.margins(x=0.18, y=0.3)
    for number, point in enumerate(points):
        if number == 0:
            axes.axhline(point.value, color="0.5", linestyle="--", linewidth=0.9)
        low, high = _ends(point)
        axes.errorbar(
            point.cost,
            point.value,
            [[point.value - low], [high - point.value]],
            fmt="o",
            color=colour,
            markerfacecolor=colour if point.certain else "white",
            capsize=3,
        )
        alike = sorted((p for p in points if _ratio(p.cost, point.cost) <= NEAR), key=lambda p: -p.value)
        place = alike.index(point)
        highest, lowest = (pick(end for p in alike for end in _ends(p)) for pick in (max, min))
        axes.annotate(
            point.name.replace("_", " "),
            (point.cost, lowest if place else highest),
            (0, 7 - 10 * place if place else 3),
            textcoords="offset points",
            ha="center",
            va="top" if place else "bottom",
            fontsize=8,
        )
    most = max((point.cost for point in points), default=1.0)
    axes.set_xticks([tick for tick in TICKS if tick <= 1.2 * most], minor=False)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}×")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.tick_params(labelsize=8)
    axes.set_ylim(bottom=max(0.0, axes.get_ylim()[0]))
