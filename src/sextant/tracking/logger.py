"""The Lightning logger: history in the run directory, mirrored to MLflow."""

import time
from argparse import Namespace
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pytorch_lightning.loggers import Logger

from sextant.runs.directory import RunDirectory
from sextant.runs.history import History
from sextant.tracking.mirror import MirroredRun


class RunLogger(Logger):
    """Writes every metric to ``history.jsonl`` and passes new ones to the mirror. It never sets a run's status.

    Args:
        directory: the run directory.
        mirror: its MLflow run; None without tracking.
    """

    def __init__(self, directory: RunDirectory, mirror: MirroredRun | None):
        super().__init__()
        self._directory, self._mirror = directory, mirror
        self._history = History(directory.history)

    @property
    def name(self) -> str:
        """The task."""
        return self._directory.path.parent.name

    @property
    def version(self) -> str:
        """The run directory's name."""
        return self._directory.path.name

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Append metrics at ``step``, except test metrics, which have their own file, and the redundant ``epoch``."""
        now = int(1000 * time.time())
        values = {n: float(v) for n, v in metrics.items() if n != "epoch" and not n.startswith("test/")}
        new = self._history.add(step or 0, now, values)
        if self._mirror is not None and new:
            self._mirror.log(new, step or 0, now)

    def log_hyperparams(self, params: dict[str, Any] | Namespace, *args: Any, **kwargs: Any) -> None:
        """Do nothing: the run's life cycle writes the config."""


@contextmanager
def system_metrics(mirror: MirroredRun | None, every_s: float) -> Iterator[None]:
    """Log ``system/*`` metrics of this machine to the run every ``every_s`` seconds while the block runs."""
    if mirror is None:
        yield
        return
    from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor

    monitor = SystemMetricsMonitor(
        mirror.run_id, sampling_interval=every_s, resume_logging=False, tracking_uri=mirror.store.uri
    )
    monitor.start()
    try:
        yield
    finally:
        monitor.finish()
