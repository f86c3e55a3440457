"""The MLflow run that stands for a sweep; its cells are its children."""

from dataclasses import replace
from pathlib import Path

from sextant.runs.directory import RunDirectory
from sextant.runs.locks import LockedError, run_lock
from sextant.runs.sweep_directory import SweepPlan, read_plan
from sextant.tracking.mirror import PARENT, MirroredRun, Status, known_run
from sextant.tracking.store import Kind, Store, open_store, telling_store_errors


def open_parent(kind: Kind, uri: str | None, outputs: Path, plan: SweepPlan, experiment: str) -> MirroredRun:
    """Open the store in the controller, before any worker does, and the parent run of a sweep in it.

    A sweep that was begun before keeps its parent.
    """
    store = open_store(kind, uri, outputs)
    experiment_id = store.experiment_id(experiment)
    key = plan.directory(outputs).name
    found = store.client.search_runs([experiment_id], f"tags.`sextant.sweep` = '{key}'", max_results=1)
    known = MirroredRun(store, found[0].info.run_id) if found else None
    mirror = known or _make_parent(store, experiment_id, plan, outputs)
    mirror.status("RUNNING")
    return mirror


def _make_parent(store: Store, experiment_id: str, plan: SweepPlan, outputs: Path) -> MirroredRun:
    key = plan.directory(outputs).name
    tags = {"mlflow.runName": key, "sextant.sweep": key, "sextant.command": " ".join(plan.command)}
    return MirroredRun(store, store.client.create_run(experiment_id, tags=tags, run_name=key).info.run_id)


def log_report(outputs: Path, plan: SweepPlan, report: Path) -> None:
    """Copy a report to the parent run of its sweep, in the store that the sweep was logged to."""
    kind: Kind = "server" if plan.tracking.get("kind") == "server" else "sqlite"
    with telling_store_errors(plan.tracking.get("uri")):
        store = open_store(kind, plan.tracking.get("uri"), outputs)
        parent = known_run(store, plan.mlflow_runs)
    if parent is not None:
        MirroredRun(store, parent).artifacts(report)


def refill_parents(store: Store, outputs: Path) -> int:
    """Make the parent runs again that a store lacks, and tie their cells to them.

    Returns:
        How many were made or ended.
    """
    made = 0
    for file in sorted(outputs.glob("sweeps/*/cells.json")):
        plan = read_plan(file.parent)
        runs = [RunDirectory(outputs / cell.run) for cell in plan.cells]
        known = known_run(store, plan.mlflow_runs)
        if known is not None:
            made += _end_if_dead(store, known, outputs, file.parent.name, runs)
        if known is not None or not plan.mlflow_runs:
            continue
        state = next((run.state() for run in runs if run.state()), {})
        parent = _make_parent(store, store.experiment_id(str(state.get("experiment", "sweeps"))), plan, outputs)
        replace(plan, mlflow_runs=[*plan.mlflow_runs, parent.run_id]).write(outputs)
        for run in runs:
            child = known_run(store, run.tracking_ids())
            if child is not None:
                MirroredRun(store, child).tags({PARENT: parent.run_id})
        parent.artifacts(file.parent / "report")
        parent.status(_status(runs))
        made += 1
    return made


def _end_if_dead(store: Store, parent: str, outputs: Path, name: str, runs: list[RunDirectory]) -> bool:
    """Set the status of a parent that is RUNNING although no process runs its sweep."""
    if store.client.get_run(parent).info.status != "RUNNING":
        return False
    try:
        with run_lock(outputs / "sweeps", name, wait=False):
            MirroredRun(store, parent).status(_status(runs))
    except LockedError:
        return False
    return True


def _status(runs: list[RunDirectory]) -> Status:
    return "FINISHED" if all(run.results() is not None for run in runs) else "KILLED"
