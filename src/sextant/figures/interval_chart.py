"""Means with their intervals as an interactive chart."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sextant.figures.charts import Spec, kinds, layered, lines, tips

#: heights of a row's label, and of each mark under it
LABEL, MARK = 20, 10
#: tick values of a logarithmic axis
DECADES = (-100, -30, -10, -3, -1, 0, 1, 3, 10, 30, 100)


@dataclass(frozen=True)
class IntervalRow:
    """One line of a chart; nan for missing values.

    Attributes:
        label: written above it; lines with the same label share a row.
        mean, low, high: the mark and its interval.
        kind: determines colour and shape.
        band: ends of the range of effects that do not matter, or that seeds alone cause.
        published: drawn as a ring.
        tip: content of the tooltip, by name.
        link: target of a click.
    """

    label: str
    mean: float
    low: float
    high: float
    kind: str = ""
    band: tuple[float, float] = (math.nan, math.nan)
    published: float = math.nan
    tip: Mapping[str, str] = field(default_factory=dict)
    link: str = ""


def interval_chart(
    rows: Sequence[IntervalRow],
    axis: str,
    title: str = "",
    *,
    order: Sequence[str] = (),
    marks: Sequence[float] = (0.0,),
    symlog: bool = False,
) -> Spec:
    """A mark and an interval for each row, from top to bottom in their order.

    Args:
        rows: what is drawn.
        axis: title of the horizontal axis.
        title: of the chart.
        order: of the kinds in the legend; that of the rows unless given.
        marks: positions of vertical lines.
        symlog: whether the axis is logarithmic outside (-1, 1).

    Returns:
        A Vega-Lite specification.

    Example:
        >>> chart = interval_chart([IntervalRow("clean", 1.0, 0.4, 1.6)], "points of accuracy")
        >>> chart["data"]["values"][0]["high"]
        1.6
    """
    names, labels = order or [*dict.fromkeys(row.kind for row in rows)], [*dict.fromkeys(row.label for row in rows)]
    told, tip_values = tips([row.tip for row in rows])
    values = [{**_values(row), **tip} for row, tip in zip(rows, tip_values, strict=True)]
    look, parameters = kinds("kind", names)
    x: Spec = {"type": "quantitative", "title": lines(axis), "scale": {"zero": False}}
    if symlog:
        x |= {"scale": {"type": "symlog"}, "axis": {"values": DECADES}}
    several = len(rows) > len(labels)
    row = LABEL + MARK * max(2, len(names) if several else 1)
    heading = {"labelAlign": "left", "labelPadding": -2, "labelOffset": 5 - row / 2, "labelLimit": 0, "title": None}
    y: Spec = {"y": {"field": "label", "sort": labels, "axis": {**heading, "ticks": False, "domain": False}}}
    if several:
        y["yOffset"] = {"field": "kind", "sort": [*names], "scale": {"paddingOuter": LABEL / MARK}}
    pointer: Spec = {"tooltip": told} | ({"href": {"field": "link"}} if any(row.link for row in rows) else {})
    shown = {key: look[key] for key in ("color", "opacity")}

    def drawn(mark: Spec, at: str, *others: Spec) -> Spec:
        return {"mark": {"clip": True, **mark}, "encoding": {"x": {"field": at, **x}, **_joined(others)}}

    bar = {"type": "bar", "color": "#8a8f98", "opacity": 0.22, "height": 14}
    dashed = {"type": "rule", "color": "currentColor", "strokeDash": [3, 3], "opacity": 0.6}
    layers = [
        drawn(bar, "from", {"x2": {"field": "to"}}, y),
        {**drawn(dashed, "mark"), "data": {"values": [{"mark": mark} for mark in marks]}},
        drawn({"type": "rule", "strokeWidth": 2.5}, "low", {"x2": {"field": "high"}}, y, shown, pointer),
        drawn({"type": "point", "filled": True, "size": 90}, "mean", y, look, pointer),
        drawn({"type": "point", "size": 120, "color": "currentColor"}, "published", y, pointer),
    ]
    there = {"mark"} if marks else set[str]()
    there |= {"mean", *(name for value in values for name in value)}
    layers = [layer for layer in layers if layer["encoding"]["x"]["field"] in there]
    next(layer for layer in layers if "color" in layer["encoding"])["params"] = (
        parameters  # the legend listens to this one
    )
    return layered(title, row * len(labels), values, layers)


def _values(row: IntervalRow) -> Spec:
    ends = {"mean": row.mean, "low": row.low, "high": row.high, "from": row.band[0], "to": row.band[1]}
    there = {name: value for name, value in {**ends, "published": row.published}.items() if math.isfinite(value)}
    return {"label": row.label, "kind": row.kind, **there, **({"link": row.link} if row.link else {})}


def _joined(parts: Sequence[Spec]) -> Spec:
    return {key: value for part in parts for key, value in part.items()}
