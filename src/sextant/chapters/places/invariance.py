"""Recall against one factor of appearance at a time, where the conditions of a dataset are named by their factors.

A condition ``fog_per_m=0.02`` is a point on the curve of ``fog_per_m``, whatever rendered or photographed it. If the
map has a named condition of :mod:`sextant.worlds.appearance`, its own value of each factor is known, and queries
``<map>_again`` under that same condition are a point on every curve.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sextant.chapters.places.condition_recall import FactorRecall, factor_recall
from sextant.chapters.places.report import NETWORK, QueryReport, logged_name, percent
from sextant.worlds.appearance import CONDITIONS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FACTOR = re.compile(r"(?P<factor>[A-Za-z]\w*)=(?P<value>[-+]?\d+(\.\d*)?(e[-+]?\d+)?)", re.IGNORECASE)
AGAIN = "_again"


def factor_of(condition: str) -> tuple[str, float] | None:
    """Factor and value of a condition named by them; None for any other name."""
    found = FACTOR.fullmatch(condition)
    return None if found is None else (found["factor"], float(found["value"]))


def has_factors(conditions: Sequence[str]) -> bool:
    """Whether any condition is named by a factor and its value."""
    return any(factor_of(name) is not None for name in conditions)


@dataclass(frozen=True)
class Invariance:
    """Curves of all methods against all factors.

    Attributes:
        curves: by factor, then by method.
        own: the map's value of each factor, if known.
        metric: name of the recall with its protocol.
    """

    curves: Mapping[str, Mapping[str, FactorRecall]]
    own: Mapping[str, float]
    metric: str


def invariance(reports: Sequence[QueryReport]) -> Invariance:
    """The curves from reports on conditions, some of which are named by factors.

    Raises:
        ValueError: no condition is.
    """
    by_factor: dict[str, list[tuple[float, QueryReport]]] = {}
    for report in reports:
        if (found := factor_of(report.protocol.query)) is not None:
            by_factor.setdefault(found[0], []).append((found[1], report))
    if not by_factor:
        raise ValueError("no condition is named by a factor and its value, such as fog_per_m=0.02")
    reference = reports[0].protocol.reference
    look = CONDITIONS.get(reference)
    own = {factor: float(getattr(look, factor)) for factor in by_factor if hasattr(look, factor)}
    again = [report for report in reports if report.protocol.query == reference + AGAIN]
    for factor, points in by_factor.items():
        points += [(own[factor], report) for report in again if factor in own]
    curves = {
        factor: {name: _curve(points, name) for name in points[0][1].methods} for factor, points in by_factor.items()
    }
    return Invariance(curves, own, f"{_without_conditions(reports[0])}, in {reference}")


def _without_conditions(report: QueryReport) -> str:
    protocol = report.protocol
    return protocol.name("recall@1").removesuffix(f"_{protocol.query}_to_{protocol.reference}")


def _curve(points: Sequence[tuple[float, QueryReport]], method: str) -> FactorRecall:
    hits = [report.methods[method].hit for _, report in points]
    return factor_recall(np.concatenate(hits), np.repeat([value for value, _ in points], [len(hit) for hit in hits]))


def invariance_metrics(reports: Sequence[QueryReport]) -> dict[str, float]:
    """Recall@1 of the network under each condition: ``test/R_at_1_..._fog_per_m_0.02_to_<map>``."""
    found = {report.protocol.name("R@1"): float(report.methods[NETWORK].hit.mean()) for report in reports}
    return {logged_name(name): value for name, value in found.items()}


def invariance_facts(found: Invariance) -> dict[str, Any]:
    """Every point of every curve with its interval, as plain lists."""
    return {
        "metric": found.metric,
        "interval": "95 %, of E. B. Wilson, queries taken as independent",
        "value_in_map": dict(found.own),
        "factors": {
            factor: {
                method: {name: column.tolist() for name, column in asdict(curve).items()}
                for method, curve in methods.items()
            }
            for factor, methods in found.curves.items()
        },
    }


def invariance_table(found: Invariance) -> list[dict[str, str]]:
    """A row per factor and method, in per cent: the mean over the values, and the value with the lowest recall."""
    rows = []
    for factor, methods in found.curves.items():
        for method, curve in methods.items():
            worst = int(curve.recall.argmin())
            rows.append(
                {
                    "factor": factor,
                    "method": method,
                    "R@1, mean of values": percent(float(curve.recall.mean())),
                    "lowest": percent(float(curve.recall[worst])),
                    "at": f"{curve.values[worst]:g}",
                    "interval": f"{percent(float(curve.low[worst]))} to {percent(float(curve.high[worst]))}",
                }
            )
    return rows


def invariance_figure(found: Invariance) -> "Figure":
    """A panel per factor, a curve per method, the network first, and a line at the map's own value."""
    from sextant.chapters.places.figures import invariance_curves

    curves = {factor: dict(reversed(list(methods.items()))) for factor, methods in found.curves.items()}
    return invariance_curves(curves, found.own, title=found.metric)
