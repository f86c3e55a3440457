"""The MLflow run that stands for a sweep; its cells are its children."""

from pathlib import Path
from typing import TYPE_CHECKING

from sextant.runs.sweep_directory import SweepPlan
from sextant.tracking.mirror import MirroredRun
from sextant.tracking.store import Kind, open_store

if TYPE_CHECKING:
    from sextant.config import Config


def open_parent(kind: Kind, uri: str | None, outputs: Path, plan: SweepPlan, config: "Config") -> MirroredRun:
    """Open the store in the controller, before any worker does, and the parent run of a sweep in it.

    A sweep that was begun before keeps its parent.
    """
    store = open_store(kind, uri, outputs)
    experiment_id = store.experiment_id(config.tracking.experiment or config.task.name)
    key = plan.directory(outputs).name
    found = store.client.search_runs([experiment_id], f"tags.`sextant.sweep` = '{key}'", max_results=1)
    if found:
        mirror = MirroredRun(store, found[0].info.run_id)
    else:
        tags = {"mlflow.runName": key, "sextant.sweep": key, "sextant.command": " ".join(plan.command)}
        run = store.client.create_run(experiment_id, tags=tags, run_name=key)
        mirror = MirroredRun(store, run.info.run_id)
    mirror.status("RUNNING")
    return mirror
