"""Reports of runs and sweeps on the terminal."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sextant.cli.show import show_start
from sextant.config import Config
from sextant.console.console import console, note_reached
from sextant.console.work_progress import work_progress
from sextant.lifecycle.run_reporter import RunReporter
from sextant.reporter import Advance
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import SweepPlan
from sextant.tables import counted

if TYPE_CHECKING:
    from pytorch_lightning.callbacks import Callback


class Terminal(RunReporter):
    """Writes to the terminal, with progress bars if there is one."""

    def say(self, text: str) -> None:
        """Print a line in yellow."""
        console.print(f"[yellow]{escape(text)}[/]")

    def progress(self, what: str, unit: str) -> AbstractContextManager[Advance]:
        """A bar, or a line every few seconds."""
        return work_progress(what, unit)

    def begin(
        self,
        config: Config,
        directory: RunDirectory,
        passed_over: tuple[str, ...],
        published: Mapping[str, Any] | None,
    ) -> None:
        """Print the summary of the config."""
        show_start(config, directory, passed_over, published)

    def training(self) -> "Sequence[Callback]":
        """A bar over all steps."""
        from sextant.cli.progress import TrainingProgress

        return [TrainingProgress()]

    def planned(self, plan: SweepPlan, finished: int) -> None:
        """Print the number of runs."""
        cells, runs = len(plan.cells), len({cell.run for cell in plan.cells})
        told = counted(runs, "run") if runs == cells else f"{cells} cells of {counted(runs, 'run')}"
        console.print(f"[bold]{plan.name}[/]: {told} planned, {finished} finished already")

    def settled(self, number: int, setting: Mapping[str, str], value: float | None, told: str) -> None:
        """Print a line about the trial."""
        note_reached("trial", f"{number} settled")
        shown = "no result" if value is None else f"{value:.5g}"
        console.print(f"trial {number}: {escape(', '.join(f'{k}={v}' for k, v in setting.items()))}  {shown}, {told}")

    @contextmanager
    def running(self) -> Iterator[Advance]:
        """A bar over the missing runs, or a line for each finished run."""
        columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
            task, before = bar.add_task("", total=None), 0

            def advance(done: int, total: int) -> None:
                nonlocal before
                bar.update(task, completed=done, total=total)
                note_reached("runs", f"{done}/{total}")
                if done > before and not console.is_terminal:
                    console.print(f"{done}/{total} runs")
                before = done

            yield advance
        note_reached("runs", None)


TERMINAL = Terminal()
