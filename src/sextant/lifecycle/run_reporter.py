"""What a run says from its start to its end."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.reporter import Reporter
from sextant.runs.directory import RunDirectory

if TYPE_CHECKING:
    from pytorch_lightning.callbacks import Callback


class RunReporter(Reporter):
    """Listens to runs. This one shows nothing."""

    def begin(
        self,
        raw: Mapping[str, Any],
        config: Config,
        directory: RunDirectory,
        passed_over: tuple[str, ...],
        published: Mapping[str, Any] | None,
    ) -> None:
        """A run begins.

        Args:
            raw, config: plain and typed.
            directory: of the run.
            passed_over: why earlier runs of the same config were not taken.
            published: what the file of a network that was not trained here says of its training.
        """

    def training(self) -> "Sequence[Callback]":
        """Callbacks that show how far training is."""
        return ()


SILENT_RUN = RunReporter()
