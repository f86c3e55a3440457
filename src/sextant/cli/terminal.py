"""What a run says, on the terminal."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from sextant.cli.console import console
from sextant.cli.show import show_start
from sextant.cli.work_progress import work_progress
from sextant.config import Config
from sextant.lifecycle.run_reporter import RunReporter
from sextant.reporter import Advance
from sextant.runs.directory import RunDirectory

if TYPE_CHECKING:
    from pytorch_lightning.callbacks import Callback


class Terminal(RunReporter):
    """Writes to the terminal, with bars where there is one."""

    def say(self, text: str) -> None:
        """A line in yellow."""
        console.print(f"[yellow]{escape(text)}[/]")

    def progress(self, what: str, unit: str) -> AbstractContextManager[Advance]:
        """A bar, or a line every few seconds."""
        return work_progress(what, unit)

    def begin(
        self,
        raw: Mapping[str, Any],
        config: Config,
        directory: RunDirectory,
        passed_over: tuple[str, ...],
        published: Mapping[str, Any] | None,
    ) -> None:
        """The summary of the config."""
        show_start(raw, config, directory, passed_over, published)

    def training(self) -> "Sequence[Callback]":
        """A bar over all steps."""
        from sextant.cli.progress import TrainingProgress

        return [TrainingProgress()]


TERMINAL = Terminal()
