"""Processor, memory and GPU use of a run, sampled by MLflow's monitor."""

from collections.abc import Iterator
from contextlib import contextmanager

from sextant.tracking.mirror import MirroredRun


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
