"""Mean error of several models by corruption, as a radar chart."""

from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from sextant.figures.classification.corruption_families import by_family
from sextant.figures.style import COLOURS

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
        >>> axes.lines[0].get_ydata()  # closed: the first comes again
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
