"""Bringing a store up to date with the run directories."""

from pathlib import Path

from sextant.errors import UserError
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory, all_runs
from sextant.runs.locks import LockedError, run_lock
from sextant.tracking.mirror import MirroredRun, Status, ended_at, finish_mirror, known_run, note_of, open_mirror
from sextant.tracking.store import Kind, Store, open_store, require_server, telling_store_errors
from sextant.tracking.sweep_parent import refill_parents


def refill(store: Store, outputs: Path, *, all_of_them: bool = True, reporter: Reporter = SILENT) -> int:
    """Make runs again that a store lacks, send what it did not get, and end those whose process is gone.

    Runs that another process is at work on are left to it.

    Args:
        store: where.
        outputs: output folder with the run directories.
        all_of_them: false looks only at runs and sweeps that log to this store, and of these only at what it did not
            get, unless it lost its database.
        reporter: hears of each run that is sent, of what the store refuses, and of sweeps that cannot be read.

    Returns:
        How many runs, and parents of sweeps, were made or repaired.

    Raises:
        UserError: the server does not answer any more, or the store refused a run; the others are up to date then.
    """
    changed: list[RunDirectory] = []
    refused: list[str] = []
    for directory in all_runs(outputs) if all_of_them else _behind(store, outputs):
        state = directory.state()
        base = f"{str(state.get('digest'))[:8]}-s{state.get('seed')}"
        try:
            with run_lock(directory.path.parent, base, wait=False):
                repaired = _refill_one(store, directory, reporter)
        except LockedError:
            continue
        if repaired:
            changed.append(directory)
        elif repaired is False:
            refused.append(f"{directory.path.parent.name}/{directory.path.name}")
    parents = refill_parents(store, outputs, changed, all_of_them=all_of_them, reporter=reporter)
    if refused:
        raise UserError(f"the tracking store {store.uri} did not take {', '.join(refused)}", "Its message is above.")
    return len(changed) + parents


def catch_up(kind: Kind, uri: str | None, outputs: Path, reporter: Reporter) -> None:
    """Send to a store what runs before could not; what fails is reported and stops nothing."""
    try:
        with telling_store_errors(uri):
            store = open_store(kind, uri, outputs)
            refill(store, outputs, all_of_them=False, reporter=reporter)
    except Exception as error:  # whatever the store raises, the run directories have everything
        reason = error.problem if isinstance(error, UserError) else str(error)
        reporter.say(f"The tracking store lacks some of the earlier runs: {reason}")


def send_again(store: Store, directory: RunDirectory) -> bool:
    """Send a run whose store failed while it ran, if the store is back; whether all of it got there."""
    try:
        if store.artifacts is None:
            require_server(store.uri)
        return finish_mirror(_open(store, directory, SILENT), directory, _status(directory))
    except Exception:  # it was told before, and the next run tries again
        return False


def _refill_one(store: Store, directory: RunDirectory, reporter: Reporter) -> bool | None:
    """Whether all of a run got to the store; None if it was there."""
    status, note = _status(directory), note_of(directory, store)
    known = known_run(store, directory.tracking_ids())
    if known is not None:
        whole = bool(store.client.list_artifacts(known))
        if whole and store.client.get_run(known).info.status == status:
            if note is not None and not note["sent"]:
                directory.update_state({"tracking": {**note, "sent": True}})
            return None
    reporter.say(f"filling {directory.path.parent.name}/{directory.path.name}")
    sent = finish_mirror(_open(store, directory, reporter), directory, status)
    if not sent and store.artifacts is None:
        require_server(store.uri)
    return sent


def _open(store: Store, directory: RunDirectory, reporter: Reporter) -> MirroredRun:
    state, note = directory.state(), note_of(directory, store) or {}
    parent = known_run(store, [note["parent_run"]] if note.get("parent_run") else [])
    experiment = str(state.get("experiment", directory.path.parent.name))
    return open_mirror(store, directory, experiment=experiment, parent=parent, reporter=reporter)


def _behind(store: Store, outputs: Path) -> list[RunDirectory]:
    """Runs that log to this store and that it did not get.

    All that log to it if it lacks the oldest or the newest that it once had: its database was lost, or is an older one.
    """
    noted = [(directory, note) for directory in all_runs(outputs) if (note := note_of(directory, store)) is not None]
    sent = sorted((directory for directory, note in noted if note["sent"]), key=ended_at)
    if any(known_run(store, directory.tracking_ids(), deleted=True) is None for directory in (*sent[:1], *sent[-1:])):
        return [directory for directory, _ in noted]
    return [directory for directory, note in noted if not note["sent"]]


def _status(directory: RunDirectory) -> Status:
    failure = directory.state().get("failure")
    if failure not in (None, "interrupted"):
        return "FAILED"
    return "FINISHED" if directory.results() is not None else "KILLED"
