"""The part of a report that draws the measure against each factor whose values are numbers."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from sextant.figures.factor_curves import FactorCurve, factor_curves
from sextant.reports.results import SweepResults
from sextant.reports.section import Section
from sextant.reports.summary import Summary
from sextant.reports.tables import is_number, slug


def factor_section(results: SweepResults, summaries: Sequence[Summary]) -> Section:
    """A picture for each such factor and setting of the others; empty without one."""
    figures, parts = [], []
    for factor in numeric_factors(results):
        made = list(_figures(results, summaries, factor))
        figures += made
        pictures = [f"![{results.measure.quantity} by {factor}]({name}.png)\n" for name, _ in made]
        parts += [f"## By {factor}\n", "Means over converged seeds with their 95 % intervals.\n", *pictures]
    return Section("\n".join(parts), figures=figures)


def numeric_factors(results: SweepResults) -> list[str]:
    """Factors with two values at least, all of them numbers."""
    found = []
    for factor in results.cells[0].cell.factors:
        values = {result.cell.factors[factor] for result in results.cells}
        if len(values) > 1 and all(is_number(value) for value in values):
            found.append(factor)
    return found


def _figures(results: SweepResults, summaries: Sequence[Summary], factor: str) -> Iterator[tuple[str, Figure]]:
    factors_of = {result.cell.setting: result.cell.factors for result in results.cells}
    row_of = {(row.setting, row.arm, row.condition): row for row in summaries}
    settings: dict[str, dict[float, str]] = {}
    for setting, factors in factors_of.items():
        others = ", ".join(value for key, value in factors.items() if key != factor)
        settings.setdefault(others, {})[float(factors[factor])] = setting
    for others, by_level in settings.items():
        levels = sorted(by_level)
        panels = {
            condition: {
                arm: _curve([row_of[by_level[level], arm, condition] for level in levels]) for arm in results.arms
            }
            for condition in results.conditions
        }
        name = "_".join(["curve", slug(factor), *([slug(others)] if others else [])])
        yield name, factor_curves(factor, np.array(levels), panels, quantity=_quantity(results), title=others)


def _curve(rows: Sequence[Summary]) -> FactorCurve:
    return FactorCurve(*(np.array([getattr(row, name) for row in rows]) for name in ("mean", "low", "high")))


def _quantity(results: SweepResults) -> str:
    """What the numbers of the table are, in a word and its unit."""
    unit = " (%)" if "per cent" in results.measure.title else ""
    return f"{results.measure.quantity}{unit}"
