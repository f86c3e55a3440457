"""The tracking store: an embedded sqlite database, or a server."""

import errno
import os
import sqlite3
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from filelock import FileLock

from sextant.addresses import file_uri, path_of, read_only, sqlite_uri
from sextant.atomic_files import write_atomically
from sextant.cache_folder import cache_folder
from sextant.errors import UserError, command
from sextant.registry import CHAPTERS, chapter_of
from sextant.runs.outputs_folder import other_than_default

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Experiment

Kind = Literal["sqlite", "server"]

#: id of the experiment that MLflow makes with each store
DEFAULT = "0"
KIND, NOTE = "mlflow.experimentKind", "mlflow.note.content"
#: how descriptions begin that this program wrote, in this and earlier versions; others are the user's
OURS = "Runs with a plus sign are sweeps"
HOW_TO_READ = f"""{OURS}.

| in the list | meaning |
| --- | --- |
| a run with a plus sign | a sweep: name, digest, arms. Its page has the question, the results and the command |
| a run below it | one cell: arm, setting, seed, digest. Its description begins with the main metric |
| tag `arm` | *Group by* it to average over the seeds of an arm |
| tag `sextant.outcome` | `finished` or `diverged`; a sweep's metric `runs/diverged` counts the latter |

To compare runs, select them and choose *Compare*.
"""


@dataclass(frozen=True)
class Store:
    """An open tracking store.

    Attributes:
        client: the MLflow client.
        uri: address of the store.
        artifacts: artifact folder of an embedded store; None for a server.
    """

    client: "MlflowClient"
    uri: str
    artifacts: Path | None

    def is_at(self, kind: str | None, uri: str | None) -> bool:
        """Whether the keys ``tracking.kind`` and ``tracking.uri`` refer to this store."""
        if self.artifacts is not None:
            return kind == "sqlite"
        return kind == "server" and (uri or "").rstrip("/") == self.uri.rstrip("/")

    def experiment_id(self, name: str) -> str:
        """The id of an experiment, created if it does not exist; safe for concurrent processes."""
        from mlflow.exceptions import MlflowException

        found = self.client.get_experiment_by_name(name)
        if found is None:
            location = None if self.artifacts is None else file_uri(self.artifacts / _folder_name(name))
            try:
                return str(self.client.create_experiment(name, artifact_location=location, tags=experiment_tags(name)))
            except MlflowException:
                found = self.client.get_experiment_by_name(name)
                if found is None:
                    raise
        if found.lifecycle_stage == "deleted":
            self.client.restore_experiment(found.experiment_id)
        self._tag(found)
        return str(found.experiment_id)

    def tidy(self) -> None:
        """Bring the tags of all experiments up to date, and delete MLflow's *Default* from an embedded store if empty.

        A deleted experiment can be restored in MLflow.
        """
        from mlflow.entities import ViewType

        for found in self.client.search_experiments():
            if found.experiment_id != DEFAULT:
                self._tag(found)
            elif self.artifacts is not None and not self.client.search_runs(
                [DEFAULT], run_view_type=ViewType.ALL, max_results=1
            ):
                self.client.delete_experiment(DEFAULT)

    def _tag(self, found: "Experiment") -> None:
        """Set the tags that an experiment lacks, and replace a description of an earlier version; keep the user's."""
        for key, value in experiment_tags(found.name).items():
            present = found.tags.get(key)
            if present is None or (present != value and key == NOTE and OURS in present):
                self.client.set_experiment_tag(found.experiment_id, key, value)


def experiment_tags(name: str) -> dict[str, str]:
    """Tags by which MLflow shows an experiment as one of model training, with a description.

    Without the kind, MLflow infers one from what was logged last, and may open its pages for language models.
    """
    about = chapter_of(name).about if name in CHAPTERS else "Runs of Sextant."
    note = f"{about}\n\n{HOW_TO_READ}"
    return {KIND: "custom_model_development", NOTE: note}


def _folder_name(experiment: str) -> str:
    """The name of the folder for an experiment's artifacts; the experiment's name may not be a valid folder name."""
    return experiment.replace("/", "_").lstrip(".").encode()[:200].decode(errors="ignore") or "_"


def store_uri(outputs: Path) -> str:
    """The address of an output folder's embedded database."""
    return sqlite_uri(outputs / "mlflow.db")


def open_store(kind: Kind, uri: str | None, outputs: Path) -> Store:
    """Open the store, creating the embedded one if it does not exist.

    The embedded database is created under a lock (MLflow itself takes none) and switched to write-ahead logging so that
    many processes can write. Its artifact addresses follow a moved output folder.

    Raises:
        UserError: the server does not answer, or the database is not one of MLflow's.
    """
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    if kind == "server":
        assert uri is not None
        require_server(uri)
        return Store(MlflowClient(uri), uri, None)

    outputs = outputs.absolute()
    database, artifacts = outputs / "mlflow.db", outputs / "artifacts"
    artifacts.mkdir(parents=True, exist_ok=True)
    uri = store_uri(outputs)
    with FileLock(outputs / ".mlflow.lock"):
        try:
            if not database.exists():
                _make_database(database)
            _require_sqlite(database)
            client = MlflowClient(uri)
            client.get_experiment("0")
            _write_ahead_and_follow(database, artifacts)
        except (sqlite3.Error, MlflowException) as error:
            raise UserError(
                f"{database} cannot be opened as a tracking store: {str(error).splitlines()[0]}",
                "Move it away: it is only a mirror, and a new one can be filled from the run directories with "
                f"{command('dashboard', outputs=other_than_default(outputs))}",
            ) from None
    return Store(client, uri, artifacts)


def how_to_fill(store: Store) -> str:
    """The command that brings a store up to date with the run directories."""
    if store.artifacts is not None:
        return command("dashboard", outputs=other_than_default(store.artifacts.parent))
    return command("dashboard", "tracking=server", f"tracking.uri={store.uri}")


@contextmanager
def telling_store_errors(uri: str | None, outputs: Path) -> Iterator[None]:
    """Turn errors that MLflow raises while a store is used into a ``UserError``.

    Args:
        uri: the address of a server; None for the embedded store.
        outputs: the output folder, which holds the embedded store.
    """
    from mlflow.exceptions import MlflowException

    try:
        yield
    except (MlflowException, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        if uri is None:
            full = "disk is full" in str(error) or (isinstance(error, OSError) and error.errno == errno.ENOSPC)
            raise UserError(
                f"the tracking store in paths.outputs={outputs} cannot be used: {reason}",
                f"{'Free some space' if full else 'Make the folder writable'}, or log later: tracking=none, and "
                "afterwards sextant dashboard",
            ) from None
        raise UserError(
            f"tracking.uri={uri}: the tracking store cannot be used: {reason}",
            "Correct the address, or log to the embedded store: tracking=sqlite",
        ) from None


def delete_runs(outputs: Path, run_ids: Sequence[str]) -> None:
    """Delete runs from the embedded store of an output folder; unknown ids are ignored."""
    from mlflow.exceptions import MlflowException

    client = open_store("sqlite", None, outputs).client
    for run_id in run_ids:
        with suppress(MlflowException):
            client.delete_run(run_id)


def require_server(uri: str) -> None:
    """Check that an MLflow server answers.

    Raises:
        UserError: it does not respond within half a minute, which allows for heavy load.
    """
    try:
        urllib.request.urlopen(f"{uri.rstrip('/')}/health", timeout=30.0).close()
    except urllib.error.HTTPError:
        return  # something responds; later requests show whether it is MLflow
    except (OSError, ValueError) as error:
        reason = getattr(error, "reason", error)
        raise UserError(
            f"tracking.uri={uri}: no MLflow server answers there ({reason})",
            "Start one, correct the address, or log to the embedded store: tracking=sqlite",
        ) from None


def _make_database(database: Path) -> None:
    """Make MLflow's tables in a temporary file and rename it, so that a kill leaves no half-made database."""
    for leftover in database.parent.glob(".mlflow.db.*.tmp*"):
        leftover.unlink()
    temporary = database.with_name(f".mlflow.db.{os.getpid()}.tmp")
    _make_tables(temporary)
    temporary.replace(database)


def _make_tables(database: Path) -> None:
    """Copy cached empty tables, or have MLflow make them, which takes seconds."""
    from mlflow import MlflowClient, __version__

    kept = cache_folder() / f"empty_mlflow_{__version__}.db"
    if _is_whole(kept):
        database.write_bytes(kept.read_bytes())
        return
    MlflowClient(sqlite_uri(database)).get_experiment("0")
    with suppress(OSError):  # without a writable cache the seconds are spent each time
        write_atomically(kept, lambda file: file.write(database.read_bytes()))


def _is_whole(database: Path) -> bool:
    """Whether a file is an intact database with MLflow's tables and its first experiment."""
    try:
        with read_only(database) as connection:
            (found,) = connection.execute("SELECT COUNT(*) FROM experiments").fetchone()
            return bool(found == 1 and connection.execute("PRAGMA quick_check").fetchone() == ("ok",))
    except sqlite3.Error:  # also raised if the file does not exist
        return False


def _require_sqlite(database: Path) -> None:
    """Raise ``sqlite3.Error`` if the file exists but is not a database, which MLflow would report in a traceback."""
    connection = sqlite3.connect(database, timeout=20)
    try:
        connection.execute("PRAGMA schema_version")
    finally:
        connection.close()


def _write_ahead_and_follow(database: Path, artifacts: Path) -> None:
    """Enable write-ahead logging, and update the artifact addresses of a moved folder."""
    connection = sqlite3.connect(database, timeout=20)
    try:
        connection.execute("PRAGMA journal_mode=WAL")
        rows = connection.execute("SELECT experiment_id, artifact_location FROM experiments").fetchall()
        for identifier, location in rows:
            here = file_uri(artifacts / path_of(location).name)
            if location == here:
                continue
            with connection:
                connection.execute(
                    "UPDATE experiments SET artifact_location = ? WHERE experiment_id = ?", (here, identifier)
                )
                connection.execute(
                    "UPDATE runs SET artifact_uri = ? || substr(artifact_uri, ?) "
                    "WHERE experiment_id = ? AND substr(artifact_uri, 1, ?) = ?",
                    (here, len(location) + 1, identifier, len(location), location),
                )
    finally:
        connection.close()
