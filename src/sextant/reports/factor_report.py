"""The part of a report that plots the measure against each numeric factor."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from sextant.figures.factor_curves import FactorCurve, factor_curves
from sextant.reports.results import SweepResults
from sextant.reports.section import Section, Summary
from sextant.tables import is_number, slug

#: least number of seeds for which an interval is drawn; the interval of two would exceed the plot
LEAST_SEEDS = 3


def factor_section(results: SweepResults, summaries: Sequence[Summary]) -> Section:
    """A plot for each numeric factor and setting of the others; empty without one."""
    figures, parts = [], []
    measure = results.measure
    legend = (
        f"Means over converged seeds, {measure.better} is better, with 95 % intervals where there are {LEAST_SEEDS} "
        "seeds or more; a line breaks where no run of an arm converged.\n"
    )
    for factor in numeric_factors(results):
        parts += [f"## By {factor}\n", legend]
        for name, others, figure in _figures(results, summaries, factor):
            figures.append((name, figure))
            parts.append(f"![{measure.quantity} by {factor}{', ' if others else ''}{others}]({name}.png)\n")
    return Section("\n".join(parts), figures=figures)


def numeric_factors(results: SweepResults) -> list[str]:
    """Factors with at least two values, all of them numbers."""
    found = []
    for factor in results.cells[0].cell.factors:
        values = {result.cell.factors[factor] for result in results.cells}
        if len(values) > 1 and all(is_number(value) for value in values):
            found.append(factor)
    return found


def _figures(results: SweepResults, summaries: Sequence[Summary], factor: str) -> Iterator[tuple[str, str, Figure]]:
    """The name of each plot, the setting of the other factors, and the plot."""
    factors_of = {result.cell.setting: result.cell.factors for result in results.cells}
    row_of = {(row.setting, row.arm, row.condition): row for row in summaries}
    settings: dict[str, dict[float, str]] = {}
    for setting, factors in factors_of.items():
        others = ", ".join(f"{key}={value}" for key, value in factors.items() if key != factor)
        settings.setdefault(others, {})[float(factors[factor])] = setting
    for others, by_level in settings.items():
        levels = sorted(by_level)
        panels = {
            condition: {
                arm: _curve([row_of.get((by_level[level], arm, condition)) for level in levels]) for arm in results.arms
            }
            for condition in results.conditions
        }
        if any(np.isfinite(curve.values).any() for curves in panels.values() for curve in curves.values()):
            name = slug("_".join(["curve", factor, *([others] if others else [])]))
            figure = factor_curves(factor, np.array(levels), panels, quantity=_quantity(results), title=others)
            yield name, others, figure


def _curve(rows: Sequence[Summary | None]) -> FactorCurve:
    """The curve of an arm; None stands for a setting without it."""
    mean, low, high = (np.array([getattr(row, name, np.nan) for row in rows]) for name in ("mean", "low", "high"))
    few = np.array([0 if row is None else row.seeds for row in rows]) < LEAST_SEEDS
    return FactorCurve(mean, np.where(few, np.nan, low), np.where(few, np.nan, high))


def _quantity(results: SweepResults) -> str:
    """The quantity in the table, with its unit."""
    measure = results.measure
    return f"{measure.quantity} ({measure.unit})" if measure.unit else measure.quantity
