"""Terminal output before and after a run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from sextant.cli.console import console, print_key_values, rows_table
from sextant.config import Config
from sextant.config.building import part_name
from sextant.lifecycle.execute import Outcome
from sextant.lifecycle.published_figures import comparison, says
from sextant.recipes import recipe_of
from sextant.runs.directory import RunDirectory


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
        console.print(f"[green]resuming from {_shorter(directory.last_checkpoint)}[/]")
    rows = {
        "task": config.task.name,
        "dataset": part_name(config.plain["dataset"]),
        **recipe_of(config.task.name).summary(config),
        **({"weights": says(published)} if published is not None else _training(config)),
        "run": _shorter(directory.path),
    }
    print_key_values("Sextant", rows)


def _training(config: Config) -> dict[str, str]:
    return {
        "optimizer": f"{part_name(config.plain['optimizer'])}, {part_name(config.plain['schedule'])}",
        "training": f"{config.trainer.max_epochs} epochs of batches of {config.trainer.batch_size}, "
        f"{config.trainer.accelerator}, {config.trainer.threads} thread(s), seed {config.seed}",
    }


def show_result(outcome: Outcome) -> None:
    """Show the final metrics of a run, and the commands that may come next."""
    directory = RunDirectory(outcome.directory)
    results = directory.results()
    if results is None:
        return
    if outcome.reused:
        console.print(f"[green]Already finished with this code and data:[/] {_shorter(directory.path)}")
    if not results["metrics"]:
        console.print(f"[red]This run diverged:[/] {escape(str(results.get('message', '')))}")
        return
    table = Table(title="Result", title_justify="left", title_style="bold")
    table.add_column("metric")
    table.add_column("value", justify="right")
    for name, value in results["metrics"].items():
        percent = "accuracy" in name
        table.add_row(name, "nan" if value is None else f"{100 * value:.2f} %" if percent else f"{value:.4f}")
    console.print(table)
    if results.get("table"):
        console.print(rows_table("On the test split", results["table"]))
    if results["outcome"] == "diverged":
        console.print("[yellow]This run did not learn: on the validation split it is near chance.[/]")
    if results.get("published"):
        console.print(f"accuracy   {escape(comparison(results['published'], results['metrics']))}")
    run, timing = _shorter(directory.path), results["timing"]
    trained = f"trained in {timing['fit_s']:.1f} s, " if timing["fit_s"] else ""
    console.print(f"{results['parameters']:,} parameters, {trained}tested in {timing['test_s']:.1f} s")
    console.print(f"figures    {run}/figures")
    if timing["fit_s"]:
        recipe = recipe_of(directory.path.parent.name)  # runs/<task>/<run>
        console.print(
            f"evaluate   sextant evaluate run={run} {recipe.evaluation_example}\n"
            f"predict    sextant predict run={run} {recipe.prediction_example} output=<folder>\n"
            f"sweep      sextant train -m {recipe.sweep_example}\n"
            f"dashboard  sextant dashboard"
        )


def _shorter(path: Path) -> str:
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
