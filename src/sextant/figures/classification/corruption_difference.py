"""Difference in error between two arms, corruption by corruption."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from sextant.figures.classification.corruption_families import by_family, name_family
from sextant.figures.style import COLOURS, new_figure, plain

BETTER, WORSE = COLOURS[0], COLOURS[1]
FLOOR: dict[str, Any] = {
    "marker": "D",
    "markersize": 4.5,
    "markerfacecolor": "white",
    "markeredgecolor": COLOURS[2],
    "markeredgewidth": 1.3,
    "linestyle": "none",
}


@dataclass(frozen=True)
class DifferenceBar:
    """Error of the treatment minus that of the control, as shares, with its interval; nan if there is none.

    ``floor`` is the noise floor: the mean difference between two groups of runs that differ only in their seeds.
    """

    label: str
    difference: float
    low: float = float("nan")
    high: float = float("nan")
    floor: float = float("nan")

    @property
    def certain(self) -> bool:
        """Whether the interval lies wholly on one side of zero."""
        return self.low > 0 or self.high < 0


def corruption_difference(
    bars: Sequence[DifferenceBar],
    *,
    mean: DifferenceBar | None = None,
    families: Mapping[str, Sequence[str]] | None = None,
    title: str = "",
    interval: str = "95 % over seeds",
) -> Figure:
    """One bar per corruption: to the left, in blue, where the treatment errs less; in orange where it errs more.

    If there are intervals, bars whose interval contains zero are pale; the others count as certain. A diamond marks the
    noise floor. The legend counts wins and losses.

    Args:
        bars: one per corruption, labelled with its name.
        mean: of all corruptions, drawn at the bottom and not counted.
        families: groups of corruptions, drawn together and named on the right; those in no group come last.
        title: the comparison, such as ``push-pull minus convolution``.
        interval: describes the whiskers.

    Raises:
        ValueError: there is nothing to draw.

    Example:
        >>> bars = [DifferenceBar("fog", -0.02, -0.03, -0.01), DifferenceBar("snow", 0.01, -0.01, 0.03)]
        >>> figure = corruption_difference(bars, title="push-pull minus convolution")
        >>> [text.get_text() for text in figure.legends[0].get_texts()[:2]]
        ['better on 1 of 2 (1 certain)', 'worse on 1 of 2 (0 certain)']
    """
    if not bars:
        raise ValueError("a difference chart needs at least one corruption")
    found = {bar.label: bar for bar in bars}
    groups = [(family, [found[name] for name in names]) for family, names in by_family(found, families or {})]
    if mean is not None:
        groups.append(("", [mean]))
    with_intervals = any(bar.low == bar.low for bar in bars)
    figure, (axes,) = new_figure(7.4, 0.25 * sum(len(members) + 0.5 for _, members in groups) + 1.5)
    row, ticks = 0.0, []
    for family, members in groups:
        name_family(axes, family, row + (len(members) - 1) / 2)
        for bar in members:
            _draw(axes, row, bar, pale=with_intervals and not bar.certain)
            ticks.append((row, bar.label.replace("_", " ")))
            row += 1
        row += 0.5
    axes.axvline(0, color="black", lw=0.8)
    axes.set_yticks([place for place, _ in ticks], [label for _, label in ticks], fontsize=8)
    axes.set_ylim(row - 0.75, -0.75)
    axes.set_xlabel("difference in error (percentage points), left is better", fontsize=8)
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=8)
    plain(axes)
    axes.grid(visible=False, axis="y")
    handles: list[Artist] = [*_counts(bars, with_intervals, interval)]
    if any(bar.floor == bar.floor for bar in bars):
        handles.append(Line2D([], [], **FLOOR, label="seeds alone (noise floor)"))
    columns = 2 if len(handles) == 4 else 3
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)
    return figure


def _draw(axes: Axes, row: float, bar: DifferenceBar, *, pale: bool) -> None:
    colour = BETTER if bar.difference < 0 else WORSE
    axes.barh(row, 100 * bar.difference, height=0.8, color=colour, alpha=0.35 if pale else 0.9)
    if bar.low == bar.low:
        axes.plot([100 * bar.low, 100 * bar.high], [row, row], color="black", lw=1.2, solid_capstyle="butt")
    if bar.floor == bar.floor:
        axes.plot(100 * bar.floor, row, **FLOOR)


def _counts(bars: Sequence[DifferenceBar], with_intervals: bool, interval: str) -> list[Patch]:
    def count(name: str, chosen: list[DifferenceBar]) -> str:
        certain = f" ({sum(bar.certain for bar in chosen)} certain)" if with_intervals else ""
        return f"{name} on {len(chosen)} of {len(bars)}{certain}"

    handles = [
        Patch(color=BETTER, label=count("better", [bar for bar in bars if bar.difference < 0])),
        Patch(color=WORSE, label=count("worse", [bar for bar in bars if bar.difference > 0])),
    ]
    if with_intervals and not all(bar.certain for bar in bars):
        handles.append(Patch(color="0.75", label=f"pale: interval contains 0 ({interval})"))
    return handles
