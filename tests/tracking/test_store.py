"""The embedded MLflow store: made once, written by many, repaired after a move."""

import errno
import multiprocessing
import os
import shutil
import signal
import sqlite3
import sys

import pytest
from odd_names import NOT_UTF8, ODD_NAMES

from sextant.errors import UserError
from sextant.lifecycle.checks import preflight
from sextant.runs.machine import machine_facts
from sextant.tracking.store import Store, open_store, require_server, telling_store_errors


def write_many(outputs, number):
    from mlflow.entities import Metric

    store = open_store("sqlite", None, outputs)
    run = store.client.create_run(store.experiment_id("stress"))
    for step in range(20):
        store.client.log_batch(run.info.run_id, [Metric(f"m{number}", float(step), 0, step)])
    store.client.set_terminated(run.info.run_id)


def race(outputs, count):
    """In a process of its own: import the store once, then open it in many processes at a time."""
    from mlflow.entities import Metric  # noqa: F401

    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=write_many, args=(outputs, number)) for number in range(count)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    sys.exit(any(worker.exitcode for worker in workers))


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """No tables are kept from before."""
    monkeypatch.setenv("SEXTANT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.mark.slow
def test_eight_processes_make_and_write_one_store(tmp_path, empty_cache):
    starter = multiprocessing.get_context("spawn").Process(target=race, args=(tmp_path, 8))
    starter.start()
    starter.join()
    assert starter.exitcode == 0
    store = open_store("sqlite", None, tmp_path)
    runs = store.client.search_runs([store.experiment_id("stress")])
    assert len(runs) == 8
    assert all(run.info.status == "FINISHED" for run in runs)
    assert all(
        len(store.client.get_metric_history(run.info.run_id, name)) == 20 for run in runs for name in run.data.metrics
    )
    assert len(store.client.search_experiments(filter_string="name = 'stress'")) == 1
    with sqlite3.connect(tmp_path / "mlflow.db") as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_artifact_addresses_follow_a_moved_folder(tmp_path):
    before, after = tmp_path / "before", tmp_path / "some where else"
    store = open_store("sqlite", None, before)
    run_id = store.client.create_run(store.experiment_id("e")).info.run_id
    (tmp_path / "note.txt").write_text("hello")
    store.client.log_artifact(run_id, str(tmp_path / "note.txt"))
    shutil.move(before, after)
    moved = open_store("sqlite", None, after)
    assert moved.client.get_run(run_id).info.artifact_uri.startswith((after / "artifacts").as_uri())
    assert [file.path for file in moved.client.list_artifacts(run_id)] == ["note.txt"]
    assert not before.exists()


def make_store_and_die(outputs):
    from mlflow.store.db import utils

    upgrade = utils._upgrade_db

    def die_halfway(engine):
        os.kill(os.getpid(), signal.SIGKILL)

    utils._upgrade_db = die_halfway if not list(outputs.glob("mlflow.db")) else upgrade
    open_store("sqlite", None, outputs)


@pytest.mark.slow
def test_a_process_killed_while_it_makes_the_database_leaves_no_half(tmp_path, empty_cache):
    maker = multiprocessing.get_context("spawn").Process(target=make_store_and_die, args=(tmp_path,))
    maker.start()
    maker.join()
    assert maker.exitcode == -signal.SIGKILL
    store = open_store("sqlite", None, tmp_path)
    assert store.client.create_run(store.experiment_id("e")).info.status == "RUNNING"
    assert not list(tmp_path.glob(".mlflow.db.*"))


def tables(outputs):
    with sqlite3.connect(outputs / "mlflow.db") as connection:
        return connection.execute("SELECT type, name FROM sqlite_master ORDER BY name").fetchall()


@pytest.mark.slow
def test_tables_are_made_once_and_then_copied(tmp_path, empty_cache, monkeypatch):
    from mlflow.store.db import utils

    open_store("sqlite", None, tmp_path / "first")
    (kept,) = empty_cache.iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(utils, "_initialize_tables", lambda engine: pytest.fail("made again"))
        store = open_store("sqlite", None, tmp_path / "second")
    assert store.client.create_run(store.experiment_id("e")).info.status == "RUNNING"
    assert tables(tmp_path / "second") == tables(tmp_path / "first")
    whole = kept.read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", b"no database"):
        kept.write_bytes(damaged)
        folder = tmp_path / f"after {len(damaged)} bytes"
        open_store("sqlite", None, folder)
        assert tables(folder) == tables(tmp_path / "first")
        assert len(kept.read_bytes()) == len(whole)


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("SEXTANT_CACHE", str(tmp_path / "file"))
    store = open_store("sqlite", None, tmp_path / "outputs")
    assert store.client.create_run(store.experiment_id("e")).info.status == "RUNNING"


def test_a_damaged_database_is_named(tmp_path):
    (tmp_path / "mlflow.db").write_bytes(b"this is no database, but it is long enough to look at" * 100)
    with pytest.raises(UserError, match=r"mlflow\.db cannot be opened as a tracking store"):
        open_store("sqlite", None, tmp_path)


def test_a_server_that_does_not_answer_is_told_at_once():
    with pytest.raises(UserError, match=r"tracking\.uri=http://127\.0\.0\.1:9: no MLflow server answers"):
        require_server("http://127.0.0.1:9")


@pytest.mark.parametrize(
    ("error", "remedy"),
    [(OSError(errno.ENOSPC, "No space left on device"), "Free some space"), (PermissionError(13, "no"), "writable")],
)
def test_errors_of_the_embedded_store_name_its_folder_and_no_address(error, remedy, tmp_path):
    with pytest.raises(UserError) as caught, telling_store_errors(None, tmp_path):
        raise error
    assert caught.value.problem.startswith(f"the tracking store in paths.outputs={tmp_path} cannot be used: ")
    assert remedy in caught.value.fix
    assert "tracking=none" in caught.value.fix
    assert "tracking.uri" not in str(caught.value)


#: one of each kind of mistake: unescaped twice, a query, a fragment, letters beyond ASCII
FEW = ("feature%2Flidar", "q?x", "c#1", "cafe\u0301")


def use(outputs, folder) -> Store:
    """A store of its own in ``outputs``, in which a metric, a file and a version of a model were logged and read."""
    outputs.mkdir()
    (folder / "hello.txt").write_text("hello")
    store = open_store("sqlite", None, outputs)
    run = store.client.create_run(store.experiment_id("digits")).info.run_id
    store.client.log_metric(run, "loss", 1.0)
    store.client.log_artifact(run, str(folder / "hello.txt"))
    store.client.create_registered_model("model")
    store.client.create_model_version("model", store.client.get_run(run).info.artifact_uri, run)
    assert [each.path for each in store.client.list_artifacts(run)] == ["hello.txt"]
    assert (outputs / "artifacts" / "digits" / run / "artifacts" / "hello.txt").read_text() == "hello"
    again = open_store("sqlite", None, outputs).client.get_run(run)
    assert again.data.metrics == {"loss": 1.0}
    assert again.info.artifact_uri == store.client.get_run(run).info.artifact_uri
    facts = {fact.name: fact.found for fact in machine_facts(outputs, None)}
    assert facts["mlflow.db"] == "sound"
    return store


def check(tmp_path, names):
    folder, parent = tmp_path / "elsewhere", tmp_path / "parent"
    folder.mkdir()
    parent.mkdir()
    for name in names:
        use(parent / name, folder)
        assert [path.name for path in parent.iterdir()] == [name]
        shutil.rmtree(parent / name)


def test_a_store_is_within_its_folder(tmp_path):
    check(tmp_path, FEW)


@pytest.mark.slow
def test_a_store_is_within_its_folder_whatever_that_is_called(tmp_path):
    check(tmp_path, [name for name in ODD_NAMES if name not in FEW])


def test_a_folder_that_a_database_address_cannot_hold_is_refused_before_anything_is_computed(tmp_path):
    with pytest.raises(UserError, match=r"paths.outputs='.*': must be a valid string, .* unicode") as caught:
        preflight([f"paths.outputs={tmp_path / NOT_UTF8}"])
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(UserError, match="no database address can hold this path"):
        open_store("sqlite", None, tmp_path / NOT_UTF8)


def test_a_name_that_an_older_sqlalchemy_cannot_hold_is_refused_before_anything_is_computed(tmp_path, monkeypatch):
    """Before 2.1 a question mark was pasted into the address, and read as its end."""
    monkeypatch.setattr("sqlalchemy.engine.URL.render_as_string", lambda url: f"sqlite:///{url.database}")
    with pytest.raises(UserError, match=r"/q\?x/mlflow.db: no database address can hold this path"):
        preflight([f"paths.outputs={tmp_path / 'q?x'}"])
    assert preflight([f"paths.outputs={tmp_path / 'q?x'}", "tracking=none"])["tracking"]["kind"] == "none"


def test_an_empty_default_experiment_is_removed_and_one_with_a_run_is_kept(tmp_path):
    for name, runs in (("empty", 0), ("used", 1)):
        store = open_store("sqlite", None, tmp_path / name)
        store.experiment_id("classification")
        for _ in range(runs):
            store.client.delete_run(store.client.create_run("0").info.run_id)  # it can be restored
        store.tidy()
        store.tidy()
        shown = {found.name for found in store.client.search_experiments()}
        assert shown == {"classification", *(["Default"] if runs else [])}
        assert open_store("sqlite", None, tmp_path / name).experiment_id("classification")


def test_experiments_of_earlier_versions_are_brought_up_to_date_and_the_users_text_is_kept(tmp_path):
    store = open_store("sqlite", None, tmp_path)
    former = "Push-pull.\n\nRuns with a plus sign are sweeps: their page has the question."
    notes = {"classification": former, "calibration": "my own words", "places": None}
    for name, note in notes.items():
        store.client.create_experiment(name, tags={} if note is None else {"mlflow.note.content": note})
    store.tidy()
    found = {each.name: each.tags for each in store.client.search_experiments()}
    assert {tags["mlflow.experimentKind"] for tags in found.values()} == {"custom_model_development"}
    assert found["calibration"]["mlflow.note.content"] == "my own words"
    for name in ("classification", "places"):
        assert "| tag `arm` |" in found[name]["mlflow.note.content"]
    assert former not in found["classification"]["mlflow.note.content"]


@pytest.mark.parametrize("name", ["a/b", "..", ".", "/etc", "a b", "50%", "x?y#z"])
def test_the_artifacts_of_an_experiment_are_in_one_folder_of_the_store(tmp_path, name):
    store = open_store("sqlite", None, tmp_path)
    run = store.client.create_run(store.experiment_id(name)).info
    (tmp_path / "hello.txt").write_text("hello")
    store.client.log_artifact(run.run_id, str(tmp_path / "hello.txt"))
    moved = open_store("sqlite", None, tmp_path)
    assert moved.client.get_run(run.run_id).info.artifact_uri == run.artifact_uri
    (found,) = (tmp_path / "artifacts").rglob("hello.txt")
    assert found.relative_to(tmp_path / "artifacts").parts[1:] == (run.run_id, "artifacts", "hello.txt")
