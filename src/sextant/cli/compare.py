"""``sextant compare``: the differences between two runs."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from sextant.console.arguments import Options
from sextant.console.console import console
from sextant.errors import UserError

USAGE = "sextant compare run=<run> run=<run>"


class CompareOptions(Options):
    """What the user chose, apart from the two runs."""

    run: str = ""
    """given twice: an MLflow run id, a run directory or its name, or a checkpoint"""
    outputs: str | None = None
    """output folder, if not the default; its runs with other seeds show the variation between seeds"""


def main(arguments: Sequence[str]) -> None:
    """Show the differences in config, code, data, versions and metrics between two runs."""
    names = [argument.removeprefix("run=") for argument in arguments if argument.startswith("run=")]
    options = CompareOptions.parse([argument for argument in arguments if not argument.startswith("run=")], USAGE)
    if len(names) != 2:
        raise UserError(f"compare needs two runs, got {len(names)}", USAGE)

    from sextant.reports.run_comparison import compare_runs
    from sextant.runs.outputs_folder import default_outputs
    from sextant.runs.resolve import resolve_run

    outputs = default_outputs() if options.outputs is None else Path(options.outputs).expanduser().absolute()
    runs = [resolve_run(name, outputs).directory for name in names]
    if runs[0] is None or runs[1] is None:
        raise UserError(f"run={names[runs.index(None)]} is a checkpoint without its run directory", "Name a run.")
    found = compare_runs(runs[0], runs[1], outputs)
    for title, differences in (("config", found.config), ("code, data, versions", found.origin)):
        _show(title, differences, names)
    for run in runs:
        if run is not None and run.results() is None:
            raise UserError(
                f"{run.metrics} is missing or damaged: the run has no metrics to compare",
                "If the run is unfinished, its command resumes it; if the file is damaged, delete the run first.",
            )
    table = Table("metric", *map(escape, names), "difference", "seeds alone", "", title="metrics", title_justify="left")
    for metric in found.metrics:
        if metric.first == metric.second:
            continue
        beyond = metric.beyond_seeds
        told = "unknown: no other seeds" if beyond is None else "[bold]more than seeds[/]" if beyond else "within"
        reach = "–" if beyond is None else f"±{metric.reach:.4g} ({metric.seeds} runs)"
        difference = f"{metric.second - metric.first:+.4g}"
        table.add_row(escape(metric.name), f"{metric.first:.4g}", f"{metric.second:.4g}", difference, reach, told)
    same = sum(metric.first == metric.second for metric in found.metrics)
    console.print(table)
    console.print(f"{same} of {len(found.metrics)} metrics are the same")


def _show(title: str, differences: Mapping[str, tuple[str, str]], names: Sequence[str]) -> None:
    if not differences:
        console.print(f"{title}: the same")
        return
    table = Table("", *map(escape, names), title=title, title_justify="left")
    for name, values in differences.items():
        table.add_row(escape(name), *map(escape, values))
    console.print(table)
