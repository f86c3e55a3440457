"""Progress of training: a bar on a terminal, or a line every few seconds elsewhere."""

import time
from typing import Any

import pytorch_lightning as pl
from pytorch_lightning.callbacks import Callback
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sextant.console.console import console, note_reached

REFRESH_S = 0.2
LINE_S = 5.0


class TrainingProgress(Callback):
    """One bar over all steps of the run, with the validation metric of the last epoch beside it."""

    def __init__(self) -> None:
        self._bar: Progress | None = None
        self._drawn = 0.0

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the bar."""
        if not console.is_terminal:
            return
        columns = (
            TextColumn("epoch {task.fields[epoch]}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[metric]}"),
        )
        self._bar = Progress(*columns, console=console, transient=True)
        total = int(trainer.estimated_stepping_batches)
        self._bar.add_task("", total=total, completed=trainer.global_step, epoch=trainer.current_epoch + 1, metric="")
        self._bar.start()

    def on_train_epoch_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Note the epoch, which is reported on Ctrl-C."""
        note_reached("epoch", f"{trainer.current_epoch + 1}/{trainer.max_epochs}")

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Remove the note; an interrupted training keeps it."""
        note_reached("epoch", None)

    def on_train_batch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule, *_: Any) -> None:
        """Move the bar, a few times a second."""
        if self._bar is not None and time.monotonic() - self._drawn > REFRESH_S:
            self._drawn = time.monotonic()
            self._bar.update(self._bar.task_ids[0], completed=trainer.global_step, epoch=trainer.current_epoch + 1)

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the validation metric."""
        name = str(pl_module.monitor)
        value = trainer.callback_metrics.get(name)
        text = "" if value is None else f"{name} {float(value):.4f}"
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], metric=text)
        elif time.monotonic() - self._drawn > LINE_S or trainer.current_epoch + 1 == trainer.max_epochs:
            self._drawn = time.monotonic()
            console.print(f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}  {text}")

    def teardown(self, trainer: pl.Trainer, pl_module: pl.LightningModule, stage: str) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
