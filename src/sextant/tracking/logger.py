"""Lightning loggers: history in the run directory, mirrored to MLflow, and a CSV file."""

import csv
import time
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pytorch_lightning.loggers import Logger

from sextant.atomic_files import write_csv
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


class CSVLogger(Logger):
    """Writes every metric into a CSV file. A resumed run keeps the rows before its own first step.

    Args:
        path: the file.
    """

    name, version = "csv", ""

    def __init__(self, path: Path):
        super().__init__()
        self._path = path
        self._columns: list[str] | None = None

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Append a row, or write all again if it has new columns."""
        row = {**metrics, "step": step or 0}
        if self._columns is not None and row.keys() <= set(self._columns):
            with self._path.open("a", newline="") as file:
                csv.DictWriter(file, self._columns).writerow(row)
            return
        columns, before = self._written()
        if self._columns is None:  # later steps of an earlier part are computed again
            before = [each for each in before if (each.get("step") or "").isdigit() and int(each["step"]) < row["step"]]
        self._columns = sorted({*columns, *row})
        write_csv(self._path, self._columns, [*before, row])

    def _written(self) -> tuple[Sequence[str], list[dict[str, str]]]:
        if not self._path.is_file():
            return (), []
        with self._path.open(newline="", errors="replace") as file:
            reader = csv.DictReader(file)
            return reader.fieldnames or (), list(reader)

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
