"""``report.py``: tables, contrasts and figures of a sweep."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from pydantic import Field
from rich.markup import escape
from rich.table import Table

from sextant.console.arguments import Options, UserPath
from sextant.console.console import console
from sextant.console.written import make_output
from sextant.tracking.environment import quiet_libraries

if TYPE_CHECKING:
    from sextant.reports.results import SweepResults
    from sextant.tables import TextTable

USAGE = """\
sextant report sweep=<name, directory or MLflow parent run> [html=<folder>] [cells=<folder>]
sextant report sweep=<folder of cells>,<folder of cells>,... [html=<folder>]"""


class ReportOptions(Options):
    """What the user chose."""

    sweep: str
    """the sweep's name, directory or MLflow parent run; or the cell folders of its blocks, to be merged"""
    outputs: str | None = None
    """output folder, if not the default"""
    tracking: Literal["none"] | None = Field(None, title="none, which keeps the report off the parent run")
    """none: do not log the report to the sweep's parent run"""
    cells: UserPath | None = None
    """folder for the finished cells as CSV, config and digests, to be merged with those of other blocks"""
    html: UserPath | None = None
    """folder for <sweep>.html: the report as a self-contained page with charts"""


def main(arguments: Sequence[str]) -> None:
    """Write the report of a sweep into its directory and log it on its parent run."""
    quiet_libraries()
    options = ReportOptions.parse(arguments, USAGE)
    for key in ("html", "cells"):
        if (folder := getattr(options, key)) is not None:
            make_output(folder, key)
    from sextant.cli.terminal import TERMINAL
    from sextant.lifecycle.results import sweep_results
    from sextant.reports.sweep_report import write_report
    from sextant.reports.tasks_report import of_several_tasks

    results = sweep_results(options.sweep, options.outputs, TERMINAL)
    paths = write_report(results)
    if options.html is not None:
        from sextant.reports.page.report_page import write_report_page

        paths.append(write_report_page(results, options.html))
    if options.cells is not None:
        from sextant.reports.stored_cells import write_cells

        paths.append(write_cells(results, options.cells))
    shows = _show_search if results.plan.is_search else _show_tasks if of_several_tasks(results) else _show
    shows(results)
    console.print("\n".join(str(path) for path in paths), markup=False, soft_wrap=True)
    if options.tracking is None and results.plan.mlflow_runs:
        from sextant.tracking.sweep_parent import log_report

        log_report(results.directory.parents[1], results.plan, results.directory / "report")


def _show_search(results: "SweepResults") -> None:
    """Show how the trials ended, and the winner."""
    from sextant.reports.search_report import summary, winner_table
    from sextant.reports.search_results import search_results

    found = search_results(results)
    console.print(f"[bold]{results.plan.name}[/]: {summary(found)}")
    if found.winner is None:
        console.print("no trial has a result, so there is no winner")
        return
    told = winner_table(found)
    setting = " ".join(f"{key}={value}" for key, value in found.winner.setting.items())
    _print_table(told, f"trial {found.winner.number}: {setting}")


def _show_tasks(results: "SweepResults") -> None:
    """Show what each task loses under corruptions."""
    from sextant.reports.tasks_report import overview_table, task_rows

    _print_table(overview_table(task_rows(results)), results.plan.name)


def _show(results: "SweepResults") -> None:
    """Show the contrasts in a table that fits a terminal; everything else is in the report."""
    from sextant.reports.contrasts import contrast_table, contrasts, footnotes
    from sextant.reports.divergence import divergence
    from sextant.tables import TextTable, counted

    counts = ", ".join(f"{results.count(name)} {name}" for name in ("finished", "diverged", "failed", "missing"))
    console.print(f"[bold]{results.plan.name}[/]: {counted(len(results.cells), 'run')} planned, {counts}")
    if told := divergence(results):
        console.print(told.replace("**", ""), markup=False, soft_wrap=True)
    rows = [row for row in contrasts(results) if row.paired is not None]
    over = f"95 % over {results.replicate}"
    columns = ["setting", "condition", "difference", over, "noise floor", "published", "pairs", "p (Wilcoxon, Holm)"]
    for name in dict.fromkeys(row.contrast for row in rows):
        title = f"{name}: {results.measure.difference}, {results.measure.better} is better"
        table = contrast_table(rows, name, results).only(columns)
        joined = [[*row[:2], f"{row[2]} {row[3]}", *row[4:]] for row in table.rows]
        _print_table(TextTable([*columns[:2], f"difference [{over}]", *columns[4:]], joined).told(), title)
    if notes := footnotes(rows):
        console.print(notes)


def _print_table(told: "TextTable", title: str) -> None:
    table = Table(*map(escape, told.columns), title=escape(title), title_justify="left", title_style="bold")
    for row in told.rows:
        table.add_row(*map(escape, row))
    console.print(table)
