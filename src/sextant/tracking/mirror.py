"""MLflow runs that mirror run directories, while they run or long afterwards."""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory
from sextant.runs.history import read_history
from sextant.tracking.store import Store, how_to_fill

Status = Literal["RUNNING", "FINISHED", "FAILED", "KILLED"]
PARENT, NOTE = "mlflow.parentRunId", "mlflow.note.content"
#: tag with the main metric of a run
RESULT = "sextant.result"
DIVERGED = "This run diverged."
#: keys of a config that a list of runs shows next to its parts
LOOKED_FOR = ("seed", "optimizer.lr", "trainer.max_epochs", "trainer.batch_size")
BATCH = 1000
FLUSH_EVERY_S = 2.0


class MirroredRun:
    """The MLflow run that mirrors one run directory.

    The directory is authoritative. If the store fails, the mirror reports this once and stops sending, and training
    goes on.

    Args:
        store: the tracking store.
        run_id: an open MLflow run.
        reporter: receives a message if the store fails.

    Attributes:
        broken: whether the store failed; nothing is sent afterwards.
    """

    def __init__(self, store: Store, run_id: str, reporter: Reporter = SILENT):
        self.store, self.run_id, self.reporter = store, run_id, reporter
        self._pending: list[tuple[str, float, int, int]] = []
        self._flushed = time.monotonic()
        self.broken = False

    def log(self, metrics: Mapping[str, float], step: int, time_ms: int) -> None:
        """Queue metrics, which are sent in batches about every two seconds."""
        self._pending += [(name, value, time_ms, step) for name, value in metrics.items()]
        if time.monotonic() - self._flushed > FLUSH_EVERY_S:
            self.flush()

    def flush(self) -> None:
        """Send the queued metrics."""
        from mlflow.entities import Metric

        pending, self._pending = self._pending, []
        for start in range(0, len(pending), BATCH):
            chunk = [Metric(*entry) for entry in pending[start : start + BATCH]]
            self._try(partial(self.store.client.log_batch, self.run_id, metrics=chunk))
        self._flushed = time.monotonic()

    def artifacts(self, path: Path) -> None:
        """Copy a file, or the files of a folder, to the run's artifacts."""
        client = self.store.client
        if path.is_dir():
            self._try(lambda: client.log_artifacts(self.run_id, str(path), path.name))
        elif path.is_file():
            self._try(lambda: client.log_artifact(self.run_id, str(path)))

    def tags(self, tags: Mapping[str, str]) -> None:
        """Set tags."""
        from mlflow.entities import RunTag

        entries = [RunTag(name, value[:5000]) for name, value in tags.items()]
        self._try(lambda: self.store.client.log_batch(self.run_id, tags=entries))

    def params(self, params: Mapping[str, Any]) -> None:
        """Log parameters. Those that the run already has are kept, as MLflow refuses to change them."""
        self._try(lambda: self._missing_params(params))

    def _missing_params(self, params: Mapping[str, Any]) -> None:
        from mlflow.entities import Param

        client = self.store.client
        known = client.get_run(self.run_id).data.params
        entries = [Param(name, str(value)[:6000]) for name, value in params.items() if name not in known]
        for start in range(0, len(entries), 100):
            client.log_batch(self.run_id, params=entries[start : start + 100])

    def status(self, status: Status, ended: float | None = None) -> None:
        """Send the queued metrics and set the run's status; ``ended`` is its end, in seconds since 1970."""
        self.flush()
        if status == "RUNNING":
            self._try(lambda: self.store.client.update_run(self.run_id, status=status))
        else:
            end_time = None if ended is None else milliseconds(ended)
            self._try(lambda: self.store.client.set_terminated(self.run_id, status=status, end_time=end_time))

    def _try(self, call: Callable[[], object]) -> None:
        if self.broken:
            return
        try:
            call()
        except Exception as error:  # the run directory is complete, whatever the store raises
            self.broken = True
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            self.reporter.say(
                f"The tracking store failed; this run sends it nothing more ({reason}). "
                f"Nothing is lost: the next run that logs there fills it from the run directories, "
                f"and so does {how_to_fill(self.store)}"
            )


def open_mirror(
    store: Store,
    directory: RunDirectory,
    *,
    experiment: str,
    parent: str | None = None,
    reporter: Reporter = SILENT,
) -> MirroredRun:
    """Open the MLflow run of a run directory: its earlier one if the store still has it, or a new one.

    If a run crashed after its MLflow run was created but before that was recorded, the MLflow run is found by its tag
    and start time. The name alone is not enough, as other output folders may log runs of the same name to the server.
    """
    state, name = directory.state(), directory.path.name
    key = f"{directory.path.parent.name}/{name}"
    started = milliseconds(state.get("started", time.time()))
    experiment_id = store.experiment_id(experiment)
    run_id = known_run(store, directory.tracking_ids())
    if run_id is None:
        query = f"tags.`sextant.run` = '{key}' and attributes.start_time = {started}"
        found = store.client.search_runs([experiment_id], query, max_results=1)
        run_id = found[0].info.run_id if found else None
    if run_id is None:
        tags = {"mlflow.runName": name, "sextant.run": key, **_kind_tags(state), **_provenance_tags(state)}
        run_id = store.client.create_run(experiment_id, start_time=started, tags=tags, run_name=name).info.run_id
    if run_id not in directory.tracking_ids():
        directory.update_state({"mlflow_runs": [*directory.tracking_ids(), run_id]})
    mirror = MirroredRun(store, run_id, reporter)
    mirror.params(clean_params(state.get("params", {})))
    if parent is not None:
        mirror.tags({PARENT: parent})
    for line in read_history(directory.history):  # the store keeps one copy of a repeated point
        mirror.log(line["metrics"], line["step"], line["time_ms"])
    mirror.status("RUNNING")
    return mirror


def finish_mirror(mirror: MirroredRun, directory: RunDirectory, status: Status) -> bool:
    """Send the final metrics and artifacts of a run directory, and set the status.

    Returns whether everything was sent, and records this in the run's state if the run logs to this store.
    """
    note = note_of(directory, mirror.store)
    results, ended = directory.results(), ended_at(directory)
    if results is not None:
        step = int(results.get("steps", 0))
        logged = {name for line in read_history(directory.history) if line["step"] == step for name in line["metrics"]}
        final = {name: value for name, value in results["metrics"].items() if value is not None}
        names = sorted(final, key=lambda name: name != main_metric(final))  # MLflow lists them in this order
        mirror.log({name: final[name] for name in names if name not in logged}, step, milliseconds(ended))
        mirror.tags({"sextant.outcome": str(results["outcome"])})
    failure = directory.state().get("failure")
    if failure:
        mirror.tags({"sextant.failure": str(failure)})
    mirror._try(lambda: describe(mirror, directory))
    for path in (directory.config, directory.metrics, directory.figures, directory.path / "trajectories"):
        mirror.artifacts(path)
    if note is not None and note["log_checkpoint"]:
        mirror.artifacts(directory.checkpoints)
    mirror.status(status, ended)
    if note is not None:
        directory.update_state({"tracking": {**note, "sent": not mirror.broken}})
    return not mirror.broken


def main_metric(metrics: Mapping[str, Any]) -> str:
    """The first metric of the test; without a test, the first metric; empty if there is none.

    >>> main_metric({"val/accuracy": 0.7, "test/accuracy/clean": 0.6, "test/accuracy/fog/1": 0.5})
    'test/accuracy/clean'
    """
    return next((name for name in metrics if name.startswith("test/")), next(iter(metrics), ""))


def main_result(directory: RunDirectory) -> str:
    """The main metric of a run and its value; its outcome if it has no metrics, and empty if it has no results."""
    results = directory.results() or {"metrics": {}, "outcome": ""}
    metrics = {name: value for name, value in results["metrics"].items() if value is not None}
    name = main_metric(metrics)
    return f"{name} = {metrics[name]:.4g}" if name else str(results["outcome"])


def described(directory: RunDirectory, about: str = "") -> str:
    """The description of a run: why it diverged if it did, its main metric, and what it is."""
    result = main_result(directory)
    parts = (why_diverged(directory), f"**{result}**" if "=" in result else "", about)
    return "\n\n".join(part for part in parts if part)


def describe(mirror: MirroredRun, directory: RunDirectory) -> bool:
    """Tag a run with its main metric and describe it; return False if it is up to date. The user's text is kept."""
    result, tags = main_result(directory), mirror.store.client.get_run(mirror.run_id).data.tags
    if not result or tags.get(RESULT) == result:
        return False
    note, former = tags.get(NOTE, ""), f"**{tags.get(RESULT)}**"
    if former in note:
        note = note.replace(former, f"**{result}**", 1)
    elif not note or note.startswith(DIVERGED):
        note = described(directory)
    mirror.tags({RESULT: result, NOTE: note})
    return True


def why_diverged(directory: RunDirectory) -> str:
    """Why a run diverged, for its description; empty for other runs."""
    results = directory.results()
    if results is None or results["outcome"] != "diverged":
        return ""
    return f"{DIVERGED} {results.get('message') or 'It did not learn.'}"


def note_of(directory: RunDirectory, store: Store) -> dict[str, Any] | None:
    """The tracking record of a run directory if it logs to this store; ``sent`` means that the store is complete."""
    note = directory.state().get("tracking")
    return note if note and store.is_at(note["kind"], note["uri"]) else None


def ended_at(directory: RunDirectory) -> float:
    """When a run ended, in seconds since 1970; for a killed run, the time of its last history entry."""
    state = directory.state()
    if state.get("ended"):
        return float(state["ended"])
    last = [line["time_ms"] / 1000 for line in read_history(directory.history)][-1:]
    return float(max([*last, state.get("started", time.time())]))


def milliseconds(seconds: float) -> int:
    """Seconds in MLflow's unit of time."""
    return int(1000 * seconds)


def known_run(store: Store, run_ids: list[str], *, deleted: bool = False) -> str | None:
    """The newest of these MLflow runs that the store has; with ``deleted``, also runs that a user deleted."""
    from mlflow.exceptions import MlflowException

    for run_id in reversed(run_ids):
        try:
            run = store.client.get_run(run_id)
        except MlflowException as error:
            if error.error_code != "RESOURCE_DOES_NOT_EXIST":  # a store that does not respond may have it
                raise
            continue
        if deleted or run.info.lifecycle_stage == "active":
            return run_id
    return None


def clean_params(params: Mapping[str, Any], keys: Sequence[str] = ()) -> dict[str, Any]:
    """The few settings that distinguish runs in a list; the artifact ``config.yaml`` has all of them.

    >>> clean_params({"seed": 0, "dataset._target_": "sextant.data.digits.Digits", "dataset.size": 28})
    {'dataset': 'Digits', 'seed': 0}

    Args:
        params: the flattened config.
        keys: keys or groups that were chosen for this run, such as ``optimizer.lr`` or ``loss``.
    """
    parts = {
        key.removesuffix("._target_"): value for key, value in params.items() if key.endswith("._target_") and value
    }
    names = {key: str(value).rpartition(".")[2] for key, value in parts.items() if "." not in key or key in keys}
    sizes = [
        key for key, value in params.items() if re.fullmatch(r"backbone\.\w+", key) and isinstance(value, int | str)
    ]
    chosen = (key for key in (*sizes, *LOOKED_FOR, *keys) if key in params and not key.endswith("._target_"))
    return {**names, **{key: params[key] for key in chosen}}


def _kind_tags(state: Mapping[str, Any]) -> dict[str, str]:
    """Tags for the task of a run and the class names of its parts, such as ``dataset: Digits``."""
    params = state.get("params", {})
    parts = {name: str(params.get(f"{name}._target_") or "") for name in ("dataset", "corruption", "backbone", "loss")}
    tags = {name: target.rpartition(".")[2] for name, target in parts.items() if target}
    return {"task": str(state.get("task", "")), **tags}


def _provenance_tags(state: Mapping[str, Any]) -> dict[str, str]:
    tags = {f"sextant.{name}": str(state[name]) for name in ("digest", "seed", "code", "data") if name in state}
    origin = state.get("provenance", {})
    git = origin.get("git", {})
    if git.get("commit"):
        tags |= {"mlflow.source.git.commit": git["commit"], "sextant.git.dirty": str(git.get("dirty"))}
    tags |= {f"version.{name}": str(value) for name, value in origin.get("versions", {}).items()}
    tags |= {f"hardware.{name}": str(value) for name, value in origin.get("hardware", {}).items()}
    return tags
