"""Common parts of the charts on pages: Vega-Lite specifications, which are plain data.

A page draws them with the library embedded in it. Their colours are visible on white and on black; text and axes take
the colour of the page.
"""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

Spec = dict[str, Any]

#: blue, orange, grey, green, purple, brown
PALETTE = ("#1f83c1", "#cf6a12", "#8a8f98", "#2a9467", "#a05fb4", "#9a7a2e")
SHAPES = ("circle", "square", "diamond", "triangle-up", "cross", "triangle-down")
_TEXT = {"labelColor": "currentColor", "titleColor": "currentColor"}
_CONFIG: Mapping[str, Any] = {
    "background": None,
    "view": {"stroke": None},
    "axis": {
        **_TEXT,
        "domainColor": "currentColor",
        "tickColor": "currentColor",
        "gridColor": "#8a8f98",
        "gridOpacity": 0.3,
    },
    "legend": {**_TEXT, "orient": "top", "columns": 3, "labelLimit": 0},
    "title": {"color": "currentColor", "anchor": "start"},
}


def layered(title: str, height: int, values: Sequence[Mapping[str, Any]], layers: Sequence[Spec]) -> Spec:
    """A chart of several layers, as wide as its container.

    >>> chart = layered("errors", 90, [{"x": 1.0}], [{"mark": "point"}])
    >>> chart["height"], chart["data"]["values"], len(chart["layer"])
    (90, [{'x': 1.0}], 1)
    """
    return {
        "$schema": "https://vega.github.io/schema/vega-lite/v6.json",  # an identifier; nothing is loaded from there
        "config": dict(_CONFIG),
        "title": lines(title),
        "width": "container",
        "autosize": {"type": "fit-x", "contains": "padding"},
        "height": height,
        "data": {"values": list(values)},
        "layer": list(layers),
    }


def lines(text: str) -> list[str]:
    """A title wrapped into lines that fit a phone.

    >>> lines("accuracy under corruptions, mean over five seeds of training")
    ['accuracy under corruptions, mean over five', 'seeds of training']
    """
    return textwrap.wrap(text, 46)


def kinds(field: str, names: Sequence[str], axes: Sequence[str] = ("x",)) -> tuple[Spec, list[Spec]]:
    """Colour and shape by kind, and parameters to show only the kind clicked in the legend and to move the axes.

    Dragging moves a chart, the wheel with the shift key zooms, and a double click resets both.

    >>> look, parameters = kinds("arm", ["control", "push-pull"])
    >>> look["color"]["scale"]
    {'domain': ['control', 'push-pull'], 'range': ['#1f83c1', '#cf6a12']}
    >>> [each["name"] for each in parameters]
    ['shown', 'moved']
    """
    legend: Spec = {} if len(names) > 1 else {"legend": None}

    def scale(found: Sequence[str]) -> Spec:
        values = [found[number % len(found)] for number in range(len(names))]
        return {
            "field": field,
            "type": "nominal",
            "title": None,
            "scale": {"domain": [*names], "range": values},
            **legend,
        }

    shown = {"name": "shown", "select": {"type": "point", "fields": [field]}, **({} if legend else {"bind": "legend"})}
    faint = {"opacity": {"condition": {"param": "shown", "value": 1}, "value": 0.1}}
    select = {"type": "interval", "encodings": [*axes], "zoom": "wheel![event.shiftKey]"}
    moved = {"name": "moved", "select": select, "bind": "scales"}
    return {"color": scale(PALETTE), "shape": scale(SHAPES), **faint}, [shown, moved]


def tips(rows: Sequence[Mapping[str, str]]) -> tuple[list[Spec], list[Spec]]:
    """Tooltips: the encoding, and the values of each row, under names that are safe in any format.

    >>> tips([{"runs": "5"}, {"runs": "3", "note": "kept"}])[1]
    [{'tip0': '5', 'tip1': ''}, {'tip0': '3', 'tip1': 'kept'}]
    """
    names = list(dict.fromkeys(name for row in rows for name in row))
    encoding = [{"field": f"tip{number}", "title": name, "type": "nominal"} for number, name in enumerate(names)]
    return encoding, [{f"tip{number}": row.get(name, "") for number, name in enumerate(names)} for row in rows]
