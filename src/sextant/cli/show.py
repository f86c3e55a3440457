"""Terminal output before and after a run."""

import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from sextant.cli.next_commands import next_commands
from sextant.composing.config_files import with_folders
from sextant.config import Config
from sextant.config.building import part_name
from sextant.console.console import console, print_key_values, rows_table
from sextant.lifecycle.execute import Outcome
from sextant.lifecycle.published_figures import comparison, says
from sextant.registry import chapter_of
from sextant.runs.directory import RunDirectory
from sextant.tables import counted

#: more metrics than this are shown only in metrics.json if a table summarises them; columns of a table
MOST, WIDTH = 20, 100


def show_start(
    config: Config,
    directory: RunDirectory,
    passed_over: tuple[str, ...],
    published: Mapping[str, Any] | None = None,
) -> None:
    """Show a summary of the config, the run directory, and why an earlier run was not reused."""
    if not config.trainer.progress:
        return
    for reason in passed_over:
        console.print(f"[yellow]{escape(reason)}: running again, into {directory.path.name}[/]")
    if directory.last_checkpoint.is_file():
        console.print(f"[green]resuming from {escape(_shorter(directory.last_checkpoint))}[/]")
    rows = {
        "task": config.task.name,
        "dataset": part_name(config.plain["dataset"]),
        **chapter_of(config.task.name).summary(config),
        **({"weights": says(published)} if published is not None else _training(config)),
        "run": _shorter(directory.path),
    }
    print_key_values("Sextant", rows)


def _training(config: Config) -> dict[str, str]:
    return {
        "optimizer": f"{part_name(config.plain['optimizer'])}, {part_name(config.plain['schedule'])}",
        "training": f"{counted(config.trainer.max_epochs, 'epoch')}{chapter_of(config.task.name).batches(config)}, "
        f"{config.trainer.accelerator}, {config.trainer.threads} thread(s), seed {config.seed}",
    }


def show_result(outcome: Outcome, typed: Sequence[str] | None = None) -> None:
    """Show the final metrics of a run, and with the overrides ``typed`` to train it here, why it did not learn."""
    directory = RunDirectory(outcome.directory)
    results = directory.results()
    if results is None:
        return
    if outcome.reused:
        console.print(f"[green]Already finished with this code and data:[/] {escape(_shorter(directory.path))}")
    if not results["metrics"]:
        console.print(f"[red]This run diverged:[/] {escape(str(results.get('message', '')))}")
        _show_divergence(directory, typed)
        return
    metrics = results["metrics"] if len(results["metrics"]) <= MOST or not results.get("table") else {}
    table = Table(title="Result", title_justify="left", title_style="bold")
    table.add_column("metric")
    table.add_column("value", justify="right")
    for name, value in metrics.items():
        percent = "accuracy" in name
        table.add_row(escape(name), "nan" if value is None else f"{100 * value:.2f} %" if percent else f"{value:.4f}")
    if metrics:
        console.print(table, width=WIDTH)
    if results.get("table"):
        console.print(rows_table("On the test split", results["table"], min(WIDTH, console.width)), width=WIDTH)
    if results.get("by_corruption") and "corruption" not in (results.get("table") or [{}])[0]:
        console.print(rows_table("By corruption", results["by_corruption"], min(WIDTH, console.width)), width=WIDTH)
    if not metrics:
        console.print(
            f"metrics    {len(results['metrics'])} in {_shorter(directory.path)}/metrics.json", soft_wrap=True
        )
    if results["outcome"] == "diverged":
        console.print("[yellow]This run did not learn.[/]")
        _show_divergence(directory, typed)
    if results.get("published"):
        console.print(f"accuracy   {escape(comparison(results['published'], results['metrics']))}")
    run, timing = _shorter(directory.path), results["timing"]
    trained = f"trained in {timing['fit_s']:.1f} s, " if timing["fit_s"] else ""
    console.print(f"{results['parameters']:,} parameters, {trained}tested in {timing['test_s']:.1f} s")
    console.print(f"figures    {run}/figures", markup=False, soft_wrap=True)


def _show_divergence(directory: RunDirectory, typed: Sequence[str] | None) -> None:
    import numpy as np

    from sextant.kit.measure import ACCURACY
    from sextant.reports.divergence import what_to_do
    from sextant.reports.results import Training

    if typed is not None:
        chapter = chapter_of(directory.path.parent.name)  # runs/<task>/<run>
        measure = ACCURACY  # a run that a nan stopped has no measurements
        if directory.arrays.exists():
            with np.load(directory.arrays, allow_pickle=False) as arrays:
                measure = chapter.measured(arrays).measure
        told = what_to_do(measure, [Training.of(directory)], ["train", *with_folders(typed)])
        console.print(told, markup=False, soft_wrap=True)


def show_next(config: Config, outcome: Outcome, typed: Sequence[str]) -> None:
    """Show suggested next commands, built from the user's overrides."""
    directory = RunDirectory(outcome.directory)
    results = directory.results()
    if results is None or not (results["timing"]["fit_s"] or 0) > 0:  # not trained here, or a nan stopped it
        return
    bin_folder = Path(sys.executable).parent
    if shutil.which("sextant") is None and (bin_folder / "activate").is_file():
        console.print(
            f"first      source {shlex.quote(_shorter(bin_folder / 'activate'))}", markup=False, soft_wrap=True
        )
    for what, line in next_commands(config, directory, _shorter(directory.path), typed).items():
        console.print(f"{what:<10} {line}", markup=False, soft_wrap=True)


def _shorter(path: Path) -> str:
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
