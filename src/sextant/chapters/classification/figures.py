"""Pictures of classifiers under corruptions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
import torch
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes
from torch import nn

from sextant.figures.style import COLOURS, new_figure, plain
from sextant.layers import PushPullConv2d, first_conv, upsample_kernel


def severity_curves(
    levels: Mapping[str, Sequence[float]],
    accuracy: Mapping[str, Mapping[str, float]],
    intervals: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
) -> Figure:
    """One panel per corruption, one curve per model; severities are evenly spaced, and clean comes first.

    Args:
        levels: severities by corruption.
        accuracy: by model, then by condition key (``clean`` or ``corruption/level``), in [0, 1].
        intervals: ends of each accuracy's interval, drawn as a band.

    Example:
        >>> figure = severity_curves({"fog": [1, 3]}, {"LeNet": {"clean": 0.99, "fog/1": 0.9, "fog/3": 0.7}})
        >>> [tick.get_text() for tick in figure.axes[0].get_xticklabels()], figure.axes[0].lines[0].get_ydata()
        (['clean', '1', '3'], array([99., 90., 70.]))
    """
    figure, panels = new_figure(4.2 * len(levels), 3.4, columns=len(levels))
    for axes, (corruption, values) in zip(panels, levels.items(), strict=True):
        keys = ["clean", *(f"{corruption}/{level:g}" for level in values)]
        positions = range(len(keys))
        for colour, (model, scores) in zip(COLOURS * 3, accuracy.items(), strict=False):
            axes.plot(positions, [100 * scores[key] for key in keys], "o-", color=colour, label=model, markersize=4)
            if intervals is not None:
                low, high = zip(*(intervals[model][key] for key in keys), strict=True)
                axes.fill_between(positions, [100 * v for v in low], [100 * v for v in high], color=colour, alpha=0.15)
        axes.set_xticks(list(positions), ["clean", *(f"{level:g}" for level in values)])
        axes.set(xlabel=corruption.replace("_", " "), ylabel="accuracy (%)", ylim=(0, 101))
        plain(axes)
    if len(accuracy) > 1:
        panels[0].legend(frameon=False, fontsize=8)
    return figure


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
) -> Figure:
    """One bar per corruption: to the left, in blue, where the treatment has fewer errors; in orange where more.

    If there are intervals, bars whose interval contains zero are pale; the others count as certain. A diamond marks the
    noise floor. The legend counts wins and losses.

    Args:
        bars: one per corruption, labelled with its name.
        mean: of all corruptions, drawn at the bottom and not counted.
        families: groups of corruptions, drawn together and named on the right; those in no group come last.
        title: the comparison, such as ``push-pull minus convolution``.

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
    handles: list[Artist] = [*_counts(bars, with_intervals)]
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


def _counts(bars: Sequence[DifferenceBar], with_intervals: bool) -> list[Patch]:
    def count(name: str, chosen: list[DifferenceBar]) -> str:
        certain = f" ({sum(bar.certain for bar in chosen)} certain)" if with_intervals else ""
        return f"{name} on {len(chosen)} of {len(bars)}{certain}"

    handles = [
        Patch(color=BETTER, label=count("better", [bar for bar in bars if bar.difference < 0])),
        Patch(color=WORSE, label=count("worse", [bar for bar in bars if bar.difference > 0])),
    ]
    if with_intervals and not all(bar.certain for bar in bars):
        handles.append(Patch(color="0.75", label="pale: interval contains 0 (95 % over seeds)"))
    return handles


def by_family(names: Iterable[str], families: Mapping[str, Sequence[str]]) -> list[tuple[str, list[str]]]:
    """Families with their members among ``names``; names in no family come last, under ``""``.

    >>> by_family(["fog", "stripe", "gaussian_noise"], {"noise": ["gaussian_noise"], "weather": ["snow", "fog"]})
    [('noise', ['gaussian_noise']), ('weather', ['fog']), ('', ['stripe'])]
    """
    found = list(names)
    groups = [(family, [name for name in members if name in found]) for family, members in families.items()]
    rest = [name for name in found if not any(name in members for members in families.values())]
    return [(family, members) for family, members in [*groups, ("", rest)] if members]


def name_family(axes: Axes, family: str, middle: float) -> None:
    """Write the name of a family upright beside the axes, at the height ``middle`` of its rows.

    >>> from sextant.figures.style import new_figure
    >>> figure, (axes,) = new_figure(3.0, 2.0)
    >>> name_family(axes, "noise", 1.5)
    >>> axes.texts[0].get_text(), axes.texts[0].get_position()
    ('noise', (1.015, 1.5))
    """
    axes.text(
        1.015,
        middle,
        family,
        transform=axes.get_yaxis_transform(),
        rotation=270,
        ha="left",
        va="center",
        fontsize=8,
        color="0.4",
    )


def corruption_heatmap(
    errors: Mapping[str, Sequence[float]],
    *,
    clean: float | None = None,
    families: Mapping[str, Sequence[str]] | None = None,
    levels: Sequence[str] | None = None,
    title: str = "",
    label: str = "severity, error (%)",
    mean: bool = True,
) -> Figure:
    """One row per corruption, one column per severity and one for their mean; cells in per cent.

    Args:
        errors: shares of wrong predictions by corruption, mildest severity first; rows may differ in length.
        clean: error on clean images, given below the title.
        families: groups of corruptions, named on the right and separated by lines; those in no group come last.
        levels: names of the severities; 1, 2, ... by default.
        title: name of the model.
        label: what the columns are.
        mean: whether to add the mean of the columns, if there are several.

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
    axes.imshow(table, cmap="YlOrRd", vmin=0, vmax=1, aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        if not np.isnan(value):
            colour = "white" if value > 0.62 else "black"
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


LEAST = 3  # fewest corruptions around a circle
STYLES, MARKERS = ("-", "--", ":", "-."), "osD^vP*"
SHADES, LAST_SHADE = ("#f1f1f1", "#ffffff"), "#e4e4e4"


def corruption_radar(
    errors: Mapping[str, Mapping[str, float]],
    *,
    families: Mapping[str, Sequence[str]] | None = None,
    title: str = "",
) -> Figure:
    """One spoke per corruption, one outline per model: the smaller, the better. The scale starts at zero in the middle.

    Args:
        errors: shares of wrong predictions by model, then by corruption; means over severities.
        families: groups of corruptions, drawn together on one background shade; those in no group come last.
        title: what the models have in common.

    Raises:
        ValueError: there is no model, there are fewer than three corruptions, or models have different corruptions.

    Example:
        >>> axes = corruption_radar({"LeNet": {"fog": 0.2, "snow": 0.3, "frost": 0.4}}).axes[0]
        >>> axes.lines[0].get_ydata()  # closed: the first value is repeated
        array([20., 30., 40., 20.])
    """
    found = list(next(iter(errors.values()), {}))
    if len(found) < LEAST or any(set(model) != set(found) for model in errors.values()):
        raise ValueError(f"a radar chart needs the same corruptions of every model, at least {LEAST}")
    groups = by_family(found, families or {})
    names = [name for _, members in groups for name in members]
    angles = 2 * np.pi * np.arange(len(names)) / len(names)
    highest = max(100 * value for model in errors.values() for value in model.values())
    step = next(s for s in (1, 2, 5, 10, 20, 25) if s >= highest / 5 or s == 25)
    limit = step * max(1, int(np.ceil(highest / step)))

    figure = Figure(figsize=(7.4, 6.6), layout="constrained")
    axes = figure.add_subplot(projection="polar")
    assert isinstance(axes, PolarAxes)
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    _shade(axes, groups, limit)
    for number, (colour, style, marker, (model, by_name)) in enumerate(
        zip(cycle(COLOURS), cycle(STYLES), cycle(MARKERS), errors.items(), strict=False)
    ):
        values = [100 * by_name[name] for name in names]
        closed = np.append(angles, angles[0]), [*values, values[0]]
        axes.plot(*closed, style, color=colour, marker=marker, markersize=3.5, lw=1.5, label=model, zorder=3 + number)
    axes.set_xticks(angles, [""] * len(names))
    axes.set_ylim(0, limit)
    axes.set_yticks(np.arange(step, limit + step / 2, step))
    axes.set_yticklabels(
        [f"{value:g} %" for value in np.arange(step, limit + step / 2, step)], fontsize=7, color="0.35"
    )
    axes.set_rlabel_position(180 / len(names))  # half-way between the first two spokes
    axes.grid(color="0.82", lw=0.6)
    axes.spines["polar"].set_color("0.7")
    for angle, name in zip(angles, names, strict=True):
        _label(axes, angle, name.replace("_", " "), limit)
    axes.set_title(title, fontsize=10, pad=34)
    figure.legend(loc="outside lower center", ncols=min(4, len(errors)), frameon=False, fontsize=9)
    return figure


def _shade(axes: PolarAxes, groups: Sequence[tuple[str, list[str]]], limit: float) -> None:
    """One sector per family, with its name inside the rim."""
    total = sum(len(members) for _, members in groups)
    start = 0
    shades = [SHADES[i % 2] for i in range(len(groups))]
    if len(groups) > 1 and shades[-1] == shades[0]:  # they meet at the top
        shades[-1] = LAST_SHADE
    for shade, (family, members) in zip(shades, groups, strict=True):
        middle = 2 * np.pi * (start + (len(members) - 1) / 2) / total
        axes.bar(middle, limit, width=2 * np.pi * len(members) / total, color=shade, zorder=0)
        if len(groups) > 1:
            axes.text(middle, 0.93 * limit, family, ha="center", va="center", fontsize=8, color="0.45", style="italic")
        start += len(members)


def _label(axes: PolarAxes, angle: float, name: str, limit: float) -> None:
    """The name of a corruption outside the rim, aligned so that it does not overlap the circle."""
    across, up = np.sin(angle), np.cos(angle)
    side = "center" if abs(across) < 0.15 else "left" if across > 0 else "right"
    place = "bottom" if up > 0.9 else "top" if up < -0.9 else "center"
    axes.text(angle, 1.05 * limit, name, ha=side, va=place, fontsize=8)


MOST = 16


def first_kernels(network: nn.Module) -> Figure | None:
    """Kernels of the first convolution, with the pull kernels of a push-pull layer below; None without one.

    Kernels of three-channel images are shown in colour, others as the mean over their channels; red is positive.

    >>> figure = first_kernels(nn.Sequential(PushPullConv2d(3, 4, 3), nn.ReLU()))
    >>> [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()], len(figure.axes)
    (['push', 'pull'], 8)
    """
    try:
        _, conv = first_conv(network)
    except ValueError:
        return None
    weight = conv.weight.detach().cpu().float()[:MOST]
    kinds = {"push" if isinstance(conv, PushPullConv2d) else "kernel": weight}
    if isinstance(conv, PushPullConv2d):
        kinds["pull"] = -upsample_kernel(weight, conv.scale)
    figure, axes = new_figure(0.9 * len(weight) + 0.6, 1.0 * len(kinds), rows=len(kinds), columns=len(weight))
    for row, (name, kernels) in enumerate(kinds.items()):
        limit = float(kernels.abs().max()) or 1.0
        for column, kernel in enumerate(kernels):
            cell = axes[row * len(weight) + column]
            if kernel.shape[0] == 3:
                cell.imshow((kernel / (2 * limit) + 0.5).permute(1, 2, 0).numpy())
            else:
                cell.imshow(torch.mean(kernel, 0).numpy(), cmap="RdBu_r", vmin=-limit, vmax=limit)
            cell.set_xticks([])
            cell.set_yticks([])
        axes[row * len(weight)].set_ylabel(name, fontsize=8)
    return figure
