"""Tables of the cells of a sweep: their distribution over seeds, the outcomes of their runs, and every run."""

import math

from sextant.reports.results import SweepResults
from sextant.reports.section import Summary
from sextant.tables import Entry, TextTable, arms_table, interval, number


def cells_table(summaries: list[Summary], results: SweepResults) -> TextTable:
    """Mean ± standard deviation over seeds, and the interval of the mean, of each cell with a converged run."""
    n = results.measure.digits
    entries = [
        Entry(
            [setting],
            arm,
            {s.condition: f"{number(s.mean, n)} ± {number(s.spread, n)} {interval(s.low, s.high, n)}" for s in of_cell},
        )
        for (setting, arm), of_cell in _by_cell(summaries).items()
        if of_cell[0].seeds
    ]
    return arms_table(["setting"], "condition", entries)


def diverged_table(summaries: list[Summary], results: SweepResults) -> TextTable:
    """The mean over all tested runs of each cell, for a sweep whose runs all diverged."""
    n = results.measure.digits
    entries = [
        Entry([setting], arm, {s.condition: number(s.all_mean, n) for s in of_cell})
        for (setting, arm), of_cell in _by_cell(summaries).items()
    ]
    return arms_table(["setting"], "condition", entries)


def cells_legend(results: SweepResults) -> str:
    """The legend of :func:`cells_table`."""
    text = f"Mean ± standard deviation over {results.replicate}, and the 95 % interval of the mean"
    if results.measure.is_share:
        return (
            f"{text}: Korn and Graubard's, for shares, which stays within 0 and 100. Where all "
            f"{results.replicate} agree, it is that of as many independent trials as there were test "
            f"{results.measure.items}.\n"
        )
    return f"{text}: Student's t.\n"


def runs_table(summaries: list[Summary]) -> TextTable:
    """The numbers of runs of each cell that converged, diverged, failed or are missing."""
    columns = ["setting", "arm", "seeds", "diverged", "failed", "missing"]
    rows = []
    for (setting, arm), (first, *_) in _by_cell(summaries).items():
        counts = (first.seeds, first.diverged, first.failed, first.missing)
        rows.append([setting, arm, *map(str, counts)])
    return TextTable(columns, rows)


def seed_rows(results: SweepResults) -> TextTable:
    """The value of every run under every condition, for a file; nan for runs that failed or were stopped by a nan."""
    rows = [
        [
            *(cell.cell.setting, cell.cell.arm, str(cell.cell.pair), str(cell.cell.seed), cell.outcome),
            *(condition, str(cell.value(condition) if cell.values else math.nan)),
            *([cell.cell.world] if results.replicate == "worlds" else []),
        ]
        for cell in results.cells
        if cell.outcome != "missing"
        for condition in results.conditions
    ]
    world = ["world"] if results.replicate == "worlds" else []
    return TextTable(["setting", "arm", "pair", "seed", "outcome", "condition", "value", *world], rows)


def _by_cell(summaries: list[Summary]) -> dict[tuple[str, str], list[Summary]]:
    found: dict[tuple[str, str], list[Summary]] = {}
    for summary in summaries:
        found.setdefault((summary.setting, summary.arm), []).append(summary)
    return found
