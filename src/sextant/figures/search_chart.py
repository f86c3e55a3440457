"""The trials of a search in order, as an interactive chart."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sextant.figures.charts import Spec, kinds, layered, tips


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
