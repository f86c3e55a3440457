"""Searches: values of trials by their number and by each parameter."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from sextant.figures.charts import Spec, kinds, layered, tips
from sextant.figures.style import COLOURS, new_figure, plain


@dataclass(frozen=True)
class TrialMark:
    """A trial: its number, mean, how it ended, and the content of its tooltip."""

    number: int
    mean: float
    state: str
    tip: Mapping[str, str]


def search_chart(trials: Sequence[TrialMark], metric: str, title: str = "") -> Spec:
    """Means of trials by number; those without a result are left out.

    Returns:
        A Vega-Lite specification.

    Example:
        >>> trials = [TrialMark(0, 0.91, "complete", {"lr": "0.1"}), TrialMark(1, math.nan, "failed", {})]
        >>> search_chart(trials, "accuracy")["data"]["values"]
        [{'trial': 0, 'mean': 0.91, 'state': 'complete', 'tip0': '0.1'}]
    """
    found = [trial for trial in trials if math.isfinite(trial.mean)]
    told, tip_values = tips([trial.tip for trial in found])
    values = [
        {"trial": t.number, "mean": t.mean, "state": t.state, **tip} for t, tip in zip(found, tip_values, strict=True)
    ]
    look, parameters = kinds("state", list(dict.fromkeys(trial.state for trial in found)), ("x", "y"))
    place = {
        "x": {"field": "trial", "type": "quantitative", "axis": {"tickMinStep": 1}, "scale": {"zero": False}},
        "y": {"field": "mean", "type": "quantitative", "title": metric, "scale": {"zero": False}},
    }
    mark = {"type": "point", "filled": True, "size": 70}
    return layered(
        title, 320, values, [{"params": parameters, "mark": mark, "encoding": {**place, **look, "tooltip": told}}]
    )


@dataclass(frozen=True)
class TrialPoint:
    """A trial: its number, mean and values at single seeds (none without a result), and whether it has all seeds."""

    number: int
    mean: float
    values: Sequence[float]
    full: bool


def search_history(trials: Sequence[TrialPoint], metric: str, *, maximize: bool) -> Figure:
    """Means of trials in the order in which they were requested, and the best so far among those with all seeds.

    A trial with fewer seeds than others is drawn hollow, one without a result as a cross on the lower edge.

    >>> trials = [TrialPoint(0, 0.90, [0.89, 0.91], True), TrialPoint(1, 0.93, [0.92, 0.94], True)]
    >>> figure = search_history(trials, "accuracy", maximize=True)
    >>> figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()
    ('trial', 'accuracy')
    """
    figure, (axes,) = new_figure(6.4, 3.4)
    found = [trial for trial in trials if trial.values]
    for full, face in ((True, COLOURS[0]), (False, "white")):
        some = [trial for trial in found if trial.full == full]
        label = "mean over all seeds" if full else "mean over its seeds so far"
        if some:
            axes.plot([t.number for t in some], [t.mean for t in some], "o", color=COLOURS[0], mfc=face, label=label)
    for trial in found:
        axes.plot([trial.number] * len(trial.values), trial.values, ".", color="0.6", markersize=3, zorder=0)
    leading = [trial for trial in found if trial.full]
    if leading:
        best = (np.maximum if maximize else np.minimum).accumulate([trial.mean for trial in leading])
        axes.step([trial.number for trial in leading], best, where="post", color=COLOURS[1], label="best so far")
    none = [trial.number for trial in trials if not trial.values]
    if none:
        across = axes.get_xaxis_transform()
        axes.plot(none, [0.02] * len(none), "x", color="black", transform=across, label="no result", clip_on=False)
    axes.set(xlabel="trial", ylabel=metric)
    plain(axes)
    if trials:
        axes.legend(frameon=False, fontsize=8)
    return figure


def importance_bars(importances: Mapping[str, float]) -> Figure:
    """The share of the metric's variance over the search space that each key accounts for, the largest on top.

    >>> figure = importance_bars({"lr": 0.8, "width": 0.2})
    >>> [float(bar.get_width()) for bar in figure.axes[0].patches]
    [0.8, 0.2]
    """
    figure, (axes,) = new_figure(5.2, 0.4 * len(importances) + 1)
    names = list(importances)
    axes.barh(range(len(names)), [importances[name] for name in names], color=COLOURS[0])
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set(xlabel="importance", xlim=(0, 1))
    plain(axes)
    return figure
