"""What runs and sweeps say from their start to their end."""

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
    """Listens to runs and sweeps. This one shows nothing."""

    def begin(
        self,
        config: Config,
        directory: RunDirectory,
        passed_over: tuple[str, ...],
        published: Mapping[str, Any] | None,
    ) -> None:
        """A run begins.

        Args:
            config: of the run.
            directory: where it lies.
            passed_over: why earlier runs of the same config were not taken.
            published: what the file of a network that was not trained here says of its training.
        """

    def training(self) -> "Sequence[Callback]":
        """Callbacks that show how far training is."""
        return ()

    def planned(self, plan: SweepPlan, finished: int) -> None:
        """A sweep is planned.

        Args:
            plan: its cells.
            finished: how many of their runs are finished already.
        """

    def settled(self, number: int, setting: Mapping[str, str], value: float | None, told: str) -> None:
        """A trial of a search gets no further seed.

        Args:
            number: of the trial.
            setting: the value of each key.
            value: its mean validation metric; None without a result.
            told: over how many seeds, or why there is none.
        """

    def running(self) -> AbstractContextManager[Advance]:
        """A context whose value is called with how many of a sweep's missing runs are done, every second."""
        return nullcontext(lambda done, total: None)


SILENT_RUN = RunReporter()
