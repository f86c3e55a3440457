"""Bringing a store up to date with the run directories."""

from pathlib import Path

from sextant.errors import UserError
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory, all_runs
from sextant.runs.locks import LockedError, run_lock
from sextant.tracking.mirror import (
    MirroredRun,
    Status,
    describe,
    ended_at,
    finish_mirror,
    known_run,
    note_of,
    open_mirror,
)
from sextant.tracking.store import Kind, Store, open_store, require_server, telling_store_errors
from sextant.tracking.sweep_parent import refill_parents


def refill(store: Store, outputs: Path, *, all_of_them: bool = True, reporter: Reporter = SILENT) -> int:
    """Recreate runs that a store lacks, send data that it did not receive, and end runs whose process is gone.

    Runs that another process is working on are skipped.

    Args:
        store: the tracking store.
        outputs: output folder with the run directories.
        all_of_them: false sends only what the store has not received of the runs and sweeps that log to it, or all of
            these if it lost its database.
        reporter: receives messages about each run sent, refusals by the store, and unreadable sweeps.

    Returns:
        The number of runs and parents of sweeps that were created or repaired.

    Raises:
        UserError: the server no longer answers, or the store refused a run; all other runs are up to date then.
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
        raise UserError(f"the tracking store {store.uri} refused {', '.join(refused)}", "Its message is above.")
    return len(changed) + parents


def catch_up(kind: Kind, uri: str | None, outputs: Path, reporter: Reporter) -> None:
    """Send a store what earlier runs could not; a failure is reported and stops nothing."""
    try:
        with telling_store_errors(uri, outputs):
            store = open_store(kind, uri, outputs)
            refill(store, outputs, all_of_them=False, reporter=reporter)
    except Exception as error:  # the run directories are complete, whatever the store raises
        reason = error.problem if isinstance(error, UserError) else str(error)
        reporter.say(f"The tracking store lacks some of the earlier runs: {reason}")


def send_again(store: Store, directory: RunDirectory) -> bool:
    """Resend a run whose store failed during the run, if the store is back; return whether everything was sent."""
    try:
        if store.artifacts is None:
            require_server(store.uri)
        return finish_mirror(_open(store, directory, SILENT), directory, _status(directory))
    except Exception:  # the failure was reported before, and the next run tries again
        return False


def _refill_one(store: Store, directory: RunDirectory, reporter: Reporter) -> bool | None:
    """Send a run to the store and return whether everything was sent; None if the store had it already."""
    status, note = _status(directory), note_of(directory, store)
    known = known_run(store, directory.tracking_ids())
    if known is not None:
        whole = bool(store.client.list_artifacts(known))
        if whole and store.client.get_run(known).info.status == status:
            if note is not None and not note["sent"]:
                directory.update_state({"tracking": {**note, "sent": True}})
            return describe(MirroredRun(store, known), directory) or None
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
    """The runs that log to this store but that it has not received.

    If the store lacks the oldest or the newest run that it once had, its database was lost or replaced by an older
    copy. All runs that log to it are returned then.
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
