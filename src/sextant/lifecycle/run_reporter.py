"""Reporters of the progress of runs and sweeps."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.reporter import Advance, Reporter
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import SweepPlan

if TYPE_CHECKING:
    from pytorch_lightning.callbacks import Callback


class RunReporter(Reporter):
    """Listens to runs and sweeps. This base class shows nothing."""

    def begin(
        self,
        config: Config,
        directory: RunDirectory,
        passed_over: tuple[str, ...],
        published: Mapping[str, Any] | None,
    ) -> None:
        """A run begins.

        Args:
            config: config of the run.
            directory: run directory.
            passed_over: reasons why earlier runs of the same config were not reused.
            published: what the file of a network trained elsewhere states about its training.
        """

    def training(self) -> "Sequence[Callback]":
        """Callbacks that show the progress of training."""
        return ()

    def planned(self, plan: SweepPlan, finished: int) -> None:
        """A sweep is planned.

        Args:
            plan: plan of the sweep.
            finished: number of runs that are already finished.
        """

    def settled(self, number: int, setting: Mapping[str, str], value: float | None, told: str) -> None:
        """A trial of a search gets no further seed.

        Args:
            number: number of the trial.
            setting: the value of each key.
            value: its mean validation metric; None without a result.
            told: the number of seeds of the mean, or why there is no result.
        """

    def running(self) -> AbstractContextManager[Advance]:
        """A context whose value is called every second with the number of a sweep's missing runs that are done."""
        return nullcontext(lambda done, total: None)


SILENT_RUN = RunReporter()
