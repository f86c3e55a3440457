"""Differences with their intervals, next to the noise floor and the published value."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.artist import Artist
from matplotlib.figure import Figure

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


def contrast_forest(panels: Sequence[tuple[str, Sequence[ForestRow]]], xlabel: str) -> Figure:
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
    handles: list[Artist] = [*axes[0].plot([], [], "o-", color=COLOURS[0], label="mean over seeds, 95 % interval")]
    if any(entry.floor_low == entry.floor_low for entry in shown):
        handles.append(axes[0].fill_betweenx([], [], [], color="0.85", label="one pair of runs, seeds alone (95 %)"))
    if any(entry.published == entry.published for entry in shown):
        published = axes[0].plot([], [], "D", color=COLOURS[1], linestyle="none", label="published, one run each")
        handles += published
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure
