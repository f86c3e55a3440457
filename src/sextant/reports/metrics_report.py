"""The part of a report that tabulates metrics of the runs other than the measure by which they are compared."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sextant.evaluation import paired_difference, share_interval
from sextant.evaluation.paired import spread_of
from sextant.evaluation.verdict import Replicate
from sextant.reports.contrasts import converged_pairs, named_contrasts, settings_of
from sextant.reports.metric import Metric, metric_of, seeds_interval
from sextant.reports.results import CellResult, SweepResults
from sextant.reports.section import Section
from sextant.tables import Entry, TextTable, arms_table, decimals, with_interval

#: name of the mean over conditions
TOGETHER = "all conditions"


@dataclass(frozen=True)
class MetricSummary:
    """One metric of one setting and arm under one condition, over converged runs.

    Attributes:
        condition: the condition, or ``TOGETHER`` for a run's value over all conditions, or else the mean of its values.
        runs: number of runs with a value.
        told, asked: numbers of values in the means, and of those that would exist if every run had all of them; a run
            that never converges, for example, has no position error.
        mean, spread: mean and standard deviation over runs.
        low, high: 95 % interval of the mean. For shares it stays within 0 and 100, and is nan where all runs agree; for
            other metrics it is Student's t.
    """

    setting: str
    arm: str
    condition: str
    metric: Metric
    runs: int
    told: int
    asked: int
    mean: float
    spread: float
    low: float
    high: float


def metrics_section(results: SweepResults) -> Section:
    """Tables of the metrics that the sweep names, or else of its measure's default ones; empty without any."""
    metrics, unknown = _told_of(results)
    if not metrics:
        return Section()
    rows = metric_summaries(results, metrics)
    conditions = [name for name in results.conditions if any(row.condition == name for row in rows)]
    meanings = [f"- *{metric.title}*: {metric.meaning}" for metric in metrics if metric.meaning]
    parts = ["## Further metrics\n", _legend(rows, results.replicate), metric_table(rows, metrics).markdown()]
    if meanings:
        parts.append("\n".join(meanings) + "\n")
    if unknown:
        parts.append(f"No run has {', '.join(unknown)}.\n")
    if len(conditions) > 1:
        table = metric_table(rows, metrics, conditions).markdown()
        parts.append(f"<details><summary>The same by condition</summary>\n\n{table}\n</details>\n")
    tables = {"metrics.csv": metric_rows(rows), "differences.csv": difference_rows(results, metrics)}
    return Section("\n".join(parts), {name: table.csv() for name, table in tables.items()})


def metric_summaries(results: SweepResults, metrics: Sequence[Metric]) -> list[MetricSummary]:
    """Every metric of every setting and arm, for all conditions together and then by condition."""
    rows = []
    for setting in results.settings:
        for arm in results.arms_of(setting):
            cells = [cell for cell in results.of(setting, arm) if cell.outcome == "finished"]
            for metric in metrics:
                rows += _of_arm(setting, arm, cells, metric, results.conditions)
    return rows


def metric_table(
    rows: Sequence[MetricSummary], metrics: Sequence[Metric], conditions: Sequence[str] | None = None
) -> TextTable:
    """Mean and interval of each metric by setting and arm, and by condition if any are given.

    Where values are missing, the table shows how many of how many exist. Metrics without a value are left out.
    """
    found = {(row.setting, row.arm, row.condition, row.metric.name): row for row in rows}
    wanted = list(conditions or [TOGETHER])
    there = {(row.condition, row.metric.name) for row in rows}
    columns = [metric for metric in metrics if any((condition, metric.name) in there for condition in wanted)]
    entries = []
    for condition in wanted:
        for setting, arm in dict.fromkeys((row.setting, row.arm) for row in rows):
            cells = {metric.title: _cell(found.get((setting, arm, condition, metric.name))) for metric in columns}
            entries.append(Entry([*([condition] if conditions else []), setting], arm, cells))
    return arms_table([*(["condition"] if conditions else []), "setting"], "metric", entries)


def metric_rows(rows: Sequence[MetricSummary]) -> TextTable:
    """The same values as plain numbers, one row each."""
    columns = ["setting", "arm", "condition", "metric", "runs", "told", "asked", "mean", "spread", "low", "high"]
    body = [
        [row.setting, row.arm, row.condition, row.metric.title]
        + [str(value) for value in (row.runs, row.told, row.asked, row.mean, row.spread, row.low, row.high)]
        for row in rows
    ]
    return TextTable(columns, body)


def difference_rows(results: SweepResults, metrics: Sequence[Metric]) -> TextTable:
    """Each contrast in each metric by condition, treatment minus control over the pairs of which both have a value."""
    body = []
    for name, sides in named_contrasts(results).items():
        for setting in settings_of(results, sides):
            pairs = converged_pairs(results, setting, sides)
            for metric in metrics:
                both = [[metric.values(cell.metrics, results.conditions) for cell in pair] for pair in pairs]
                for condition in results.conditions:
                    there = [(a[condition], b[condition]) for a, b in both if condition in a and condition in b]
                    if there:
                        treatment, control = np.array(there).T
                        found = paired_difference(treatment, control)
                        told = (found.seeds, found.mean, found.spread, found.low, found.high)
                        body.append([name, setting, condition, metric.name, *map(str, told), results.replicate])
    columns = ["contrast", "setting", "condition", "metric", "seeds", "mean", "spread", "low", "high", "replicate"]
    return TextTable(columns, body)


def _told_of(results: SweepResults) -> tuple[list[Metric], list[str]]:
    """The metrics that at least one run has, and the names of requested ones that no run has."""
    asked = list(results.plan.definition.get("metrics") or [])
    wanted = [metric_of(name) for name in asked or results.measure.metrics]
    told = [m for m in wanted if any(m.values(cell.metrics, results.conditions) for cell in results.cells)]
    return told, [metric.name for metric in wanted if metric not in told] if asked else []


def _of_arm(
    setting: str, arm: str, cells: Sequence[CellResult], metric: Metric, conditions: Sequence[str]
) -> list[MetricSummary]:
    each = [metric.values(cell.metrics, conditions) for cell in cells]
    names = list(dict.fromkeys(name for values in each for name in values if name))
    rows = []
    if any(each):
        whole = [{"": values[""]} if "" in values else values for values in each]
        pooled = [float(np.mean(list(values.values()))) for values in whole if values]
        asked = sum(1 if "" in values else max(1, len(names)) for values in whole)
        rows.append(_summary(setting, arm, TOGETHER, metric, pooled, sum(map(len, whole)), asked))
    for name in names:
        told = [values[name] for values in each if name in values]
        rows.append(_summary(setting, arm, name, metric, told, len(told), len(cells)))
    return rows


def _summary(
    setting: str, arm: str, condition: str, metric: Metric, values: Sequence[float], told: int, asked: int
) -> MetricSummary:
    found = np.array(values)
    if metric.is_share:
        low, high = (metric.scale * end for end in share_interval(found / metric.scale))
    else:
        low, high = seeds_interval(metric.name, found)
    return MetricSummary(
        setting, arm, condition, metric, len(found), told, asked, float(found.mean()), spread_of(found), low, high
    )


def _cell(row: MetricSummary | None) -> str:
    if row is None:
        return "–"
    digits = decimals(max(abs(value) for value in (row.mean, row.low, row.high) if value == value))
    some = f" ({row.told} of {row.asked})" if row.told < row.asked else ""
    return with_interval(row, digits, alone=True) + some


def _legend(rows: Sequence[MetricSummary], replicate: Replicate) -> str:
    some = " *(k of n)*: only k of n values exist, such as errors of runs that converged." if any(
        row.told < row.asked for row in rows
    ) else ""  # fmt: skip
    return (
        f"Means over converged runs with their 95 % intervals over {replicate}: of shares Korn and Graubard's, which "
        "stays within 0 and 100 (none where all runs agree), of other metrics Student's t; of a run, its value for all "
        f"conditions together, or the mean over them.{some} Times were measured under whatever load the machine had.\n"
    )
