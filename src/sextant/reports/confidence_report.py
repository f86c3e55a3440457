"""The part of a report on classifiers' confidence: calibration error and likelihood, clean and by corruption."""

from collections.abc import Mapping, Sequence

import numpy as np

from sextant.evaluation.confidence import BINS
from sextant.evaluation.headline import CLEAN, over_severities
from sextant.reports.corruption_contrasts import OverSeeds
from sextant.reports.results import CellResult, SweepResults
from sextant.reports.section import Section
from sextant.tables import Entry, TextTable, arms_table, counted, with_interval

CORRUPTED = "corrupted"
#: metrics by their heading, with the number of decimals shown
FIGURES = {"ECE": ("test/ece/", 4), "NLL": ("test/nll/", 3)}


def confidence_section(results: SweepResults) -> Section:
    """Tables of ECE and NLL by arm; empty if no run has them; runs of older versions lack both."""
    told = {
        (setting, arm): [_by_corruption(cell) for cell in results.of(setting, arm) if cell.outcome == "finished"]
        for setting in results.settings
        for arm in results.arms
    }
    told = {key: kept for key, runs in told.items() if (kept := [figures for figures in runs if figures])}
    runs = sum(map(len, told.values()))
    if not runs:
        return Section()
    without = results.count("finished") - runs
    text = (
        f"ECE with {BINS} bins of equal width over the probability of the predicted class (Guo et al. 2017), and the "
        "mean negative log-likelihood of the true class in nats; lower is better. *corrupted* is the mean over "
        "severities, then over corruptions. Means over converged runs with 95 % t intervals."
    )
    if without:
        text += f" {counted(without, 'converged run')} without these figures, of an older version, left out."
    names = list(dict.fromkeys(name for figures in told.values() for run in figures for name in run["ECE"]))
    few = [name for name in names if name in (CLEAN, CORRUPTED)]
    parts = ["## Confidence\n", text + "\n", _table(told, few).markdown()]
    if len(names) > len(few):
        parts.append(
            f"<details><summary>By corruption</summary>\n\n{_table(told, names, rows=True).markdown()}\n</details>\n"
        )
    return Section("\n".join(parts), {"confidence.csv": _rows(told, names).csv()})


Told = Mapping[tuple[str, str], Sequence[Mapping[str, Mapping[str, float]]]]


def _by_corruption(cell: CellResult) -> dict[str, dict[str, float]]:
    """ECE and NLL of one run: clean, by corruption, and the mean over corruptions; empty without both."""
    found: dict[str, dict[str, float]] = {}
    for title, (prefix, _) in FIGURES.items():
        means = over_severities(cell.metrics, prefix)
        if not means:
            return {}
        under = [value for name, value in means.items() if name != CLEAN]
        found[title] = {CLEAN: means.get(CLEAN, float("nan"))}
        found[title] |= ({CORRUPTED: float(np.mean(under))} if under else {}) | means
    return found


def _over(runs: Sequence[Mapping[str, Mapping[str, float]]], figure: str, name: str) -> OverSeeds:
    return OverSeeds.of([run[figure][name] for run in runs if name in run[figure]])


def _table(told: Told, names: Sequence[str], *, rows: bool = False) -> TextTable:
    entries = []
    for (setting, arm), runs in told.items():
        cells = {
            (name, figure): with_interval(_over(runs, figure, name), digits, alone=True)
            for name in names
            for figure, (_, digits) in FIGURES.items()
        }
        if rows:
            entries += [
                Entry([setting, name], arm, {figure: cells[name, figure] for figure in FIGURES}) for name in names
            ]
        else:
            entries.append(Entry([setting], arm, {f"{figure}, {name}": cells[name, figure] for name, figure in cells}))
    return arms_table(["setting", "corruption"] if rows else ["setting"], "figure", entries)


def _rows(told: Told, names: Sequence[str]) -> TextTable:
    columns = ["setting", "arm", "corruption", "figure", "seeds", "mean", "spread", "low", "high"]
    body = []
    for (setting, arm), runs in told.items():
        for name in names:
            for figure in FIGURES:
                found = _over(runs, figure, name)
                values = (found.mean, found.spread, found.low, found.high)
                body.append([setting, arm, name, figure, str(len(runs)), *map(str, values)])
    return TextTable(columns, body)
