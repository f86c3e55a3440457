"""Recall against one factor of appearance at a time, where the conditions of a dataset are named by their factors.

A condition ``fog_per_m=0.02`` is a point on the curve of ``fog_per_m``, whether rendered or photographed. If the
map has a named condition of :mod:`sextant.worlds.appearance`, its own value of each factor is known, and queries
``<map>_again`` under that same condition are a point on every curve.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.baselines.place_descriptors import unit_norm
from sextant.chapters.places.data import PlaceImages, PlaceTolerance
from sextant.chapters.places.metrics import ConditionRecall, FactorRecall, condition_recall, factor_recall
from sextant.chapters.places.report import NETWORK, QueryReport, logged_name, percent, protocol_of
from sextant.evaluation.positives import Positives
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
        ValueError: no condition is named by a factor.
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


def condition_pairs(
    descriptors: Float32[ndarray, "n d"], places: PlaceImages, tolerance: PlaceTolerance
) -> ConditionRecall:
    """Recall@1 between all pairs of conditions of the described images, without copies of other conditions.

    Descriptors are normalised as in :func:`~sextant.chapters.places.report.compare`: if two references are equally near
    in float32, different rounding could choose the other one, and the same metric would have two values.
    """
    if places.copies:
        names = places.originals
        descriptors = descriptors[np.concatenate([places.rows_of(name) for name in names])]
        places = places.only_conditions(names)
    every = np.arange(len(places))
    positives = Positives.from_sparse(places.positives(every, every, tolerance))
    return condition_recall(unit_norm(descriptors), places.traverse, positives, places.conditions)


def pair_metrics(pairs: ConditionRecall, tolerance: PlaceTolerance) -> dict[str, float]:
    """``test/R_at_1_<tolerance>_<query>_to_<reference>`` for every pair of conditions, and the mean ``..._across``.

    A condition against itself is only in :func:`pair_arrays`: an image without a second one of its place has no match.
    """
    found = {protocol_of(tolerance).name("R@1_across"): pairs.across}
    for (row, column), value in np.ndenumerate(pairs.recall):
        if row != column:
            names = pairs.conditions[row], pairs.conditions[column]
            found[protocol_of(tolerance, *names).name("R@1")] = float(value)
    return {logged_name(name): value for name, value in found.items() if value == value}


def pair_arrays(pairs: ConditionRecall, tolerance: PlaceTolerance) -> dict[str, ndarray]:
    """Tables with a row per query condition and a column per reference condition, and their names."""
    name = protocol_of(tolerance).name("R@1")
    return {
        f"{name}/pairs/conditions": np.array(pairs.conditions),
        f"{name}/pairs/recall": pairs.recall,
        f"{name}/pairs/queries": pairs.queries,
        f"{name}/pairs/queries_without_positive": pairs.unmatchable,
    }
