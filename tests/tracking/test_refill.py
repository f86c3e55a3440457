"""A store that was away, or lost its database, ends with every run once."""

import json

import pytest
from support import Hears, quick_config

from sextant import cli
from sextant.atomic_files import write_json
from sextant.chapters.classification.task import Classification
from sextant.errors import UserError
from sextant.lifecycle import execute as life
from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan, find_sweep, read_plan
from sextant.tracking.mirror import finish_mirror, open_mirror
from sextant.tracking.refill import refill
from sextant.tracking.store import open_store
from sextant.tracking.sweep_parent import refill_parents

HERE = {"kind": "sqlite", "uri": None, "parent_run": None, "log_checkpoint": True, "sent": False}


def made_up_run(outputs, seed, *, finished=True, **state):
    """A run directory as a run leaves it."""
    run = RunDirectory(outputs / "runs" / "classification" / f"12345678-s{seed}")
    run.checkpoints.mkdir(parents=True)
    run.last_checkpoint.write_bytes(b"weights")
    run.config.write_text("seed: 0\n")
    line = {"step": 1, "time_ms": 1000 * (110 + 100 * seed), "metrics": {"train/loss": 0.5}}
    run.history.write_text(json.dumps(line) + "\n")
    began = {"digest": "12345678", "seed": seed, "experiment": "e", "started": 100.0 * (1 + seed), "tracking": HERE}
    run.update_state(began | {"params": {"a": 1}} | ({"ended": 150.0 + 100 * seed} if finished else {}) | state)
    if finished:
        write_json(run.metrics, {"outcome": "finished", "steps": 2, "metrics": {"test/accuracy/clean": 0.9}})
    return run


def runs_in(store, experiment="e"):
    return store.client.search_runs([store.experiment_id(experiment)])


def test_a_run_that_was_not_sent_gets_there_whole_and_once(tmp_path):
    run, store = made_up_run(tmp_path, 0), open_store("sqlite", None, tmp_path)
    assert refill(store, tmp_path, all_of_them=False) == 1
    (found,) = runs_in(store)
    assert (found.info.status, found.info.start_time, found.info.end_time) == ("FINISHED", 100_000, 150_000)
    assert found.data.metrics == {"train/loss": 0.5, "test/accuracy/clean": 0.9}
    artifacts = {
        file.path for folder in ("", "checkpoints") for file in store.client.list_artifacts(found.info.run_id, folder)
    }
    assert {"config.yaml", "metrics.json", "checkpoints/last.ckpt"} <= artifacts
    assert run.state()["tracking"]["sent"]
    assert refill(store, tmp_path, all_of_them=False) == 0
    assert len(runs_in(store)) == 1


def test_the_description_of_a_run_begins_with_its_main_metric_and_the_users_text_is_kept(tmp_path):
    for seed in range(2):
        made_up_run(tmp_path, seed)
    store = open_store("sqlite", None, tmp_path)
    refill(store, tmp_path)
    first, second = runs_in(store)
    assert first.data.tags["mlflow.note.content"] == "**test/accuracy/clean = 0.9**"
    for run, note in ((first, "mine"), (second, "")):
        store.client.set_tag(run.info.run_id, "mlflow.note.content", note)
        store.client.delete_tag(run.info.run_id, "sextant.result")  # as before there was one
    assert refill(store, tmp_path) == 2
    notes = [store.client.get_run(run.info.run_id).data.tags["mlflow.note.content"] for run in (first, second)]
    assert notes == ["mine", "**test/accuracy/clean = 0.9**"]
    assert refill(store, tmp_path) == 0


def test_a_run_that_logs_elsewhere_is_left_to_whoever_asks_for_all(tmp_path):
    made_up_run(tmp_path, 0, tracking={**HERE, "kind": "server", "uri": "http://there"})
    store = open_store("sqlite", None, tmp_path)
    assert refill(store, tmp_path, all_of_them=False) == 0
    assert refill(store, tmp_path) == 1
    (found,) = runs_in(store)
    assert "checkpoints" not in {file.path for file in store.client.list_artifacts(found.info.run_id)}


def test_a_lost_database_is_noticed_though_later_runs_are_there(tmp_path):
    """The first two were sent to a database that is gone, the third to the new one."""
    for seed in range(2):
        made_up_run(tmp_path, seed, mlflow_runs=["0" * 32], tracking={**HERE, "sent": True})
    made_up_run(tmp_path, 2)
    store = open_store("sqlite", None, tmp_path)
    assert refill(store, tmp_path, all_of_them=False) == 3
    assert sorted(run.info.start_time for run in runs_in(store)) == [100_000, 200_000, 300_000]


def test_a_run_that_was_deleted_in_mlflow_does_not_come_back_by_itself(tmp_path):
    run, store = made_up_run(tmp_path, 0), open_store("sqlite", None, tmp_path)
    refill(store, tmp_path)
    store.client.delete_run(run.tracking_ids()[-1])
    assert refill(store, tmp_path, all_of_them=False) == 0
    assert refill(store, tmp_path) == 1


def test_a_store_that_does_not_answer_is_no_store_without_the_run(tmp_path, monkeypatch):
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    made_up_run(tmp_path, 0)
    store = open_store("sqlite", None, tmp_path)
    refill(store, tmp_path)

    def away(*_):
        raise MlflowException("the server is away")

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "get_run", away)
        with pytest.raises(MlflowException, match="away"):
            refill(store, tmp_path)
    assert len(runs_in(store)) == 1


def test_a_run_that_the_store_refuses_is_named_and_the_others_get_there(tmp_path, monkeypatch):
    from mlflow import MlflowClient

    log_batch = MlflowClient.log_batch
    for seed in range(2):
        made_up_run(tmp_path, seed, params={"seed": seed})

    def refusing(self, run_id, metrics=(), params=(), **others):
        if any(param.value == "0" for param in params):
            raise OSError("not this one")
        return log_batch(self, run_id, metrics=metrics, params=params, **others)

    monkeypatch.setattr(MlflowClient, "log_batch", refusing)
    listener = Hears()
    with pytest.raises(UserError, match="refused classification/12345678-s0"):
        refill(open_store("sqlite", None, tmp_path), tmp_path, reporter=listener)
    assert any("not this one" in text for text in listener.said)
    store = open_store("sqlite", None, tmp_path)
    assert sorted(run.info.status for run in runs_in(store)) == ["FINISHED", "RUNNING"]


def test_runs_of_one_name_in_two_folders_are_two_runs(tmp_path):
    """As when two people log the same config to one server."""
    store = open_store("sqlite", None, tmp_path)
    for folder, started in (("a", 100.0), ("b", 300.0)):
        run = made_up_run(tmp_path / folder, 0, started=started)
        finish_mirror(open_mirror(store, run, experiment="e"), run, "FINISHED")
        run.update_state({"mlflow_runs": []})  # killed before the note of it
        finish_mirror(open_mirror(store, run, experiment="e"), run, "FINISHED")
    assert sorted(run.info.start_time for run in runs_in(store)) == [100_000, 300_000]


@pytest.mark.parametrize("noted", [True, False])
def test_a_parent_that_was_lost_has_its_times_and_its_cells(tmp_path, noted):
    """Sweeps of before have no times of their own: then the first start and the last end of their runs."""
    for seed in range(2):
        made_up_run(tmp_path, seed, tracking={**HERE, "parent_run": "0" * 32} if noted else None)
    made_up_run(tmp_path, 2, tracking={**HERE, "parent_run": "1" * 32})
    cells = [Cell({}, "run", seed, seed, "12345678", f"runs/classification/12345678-s{seed}") for seed in range(3)]
    times = {"began": 90.0, "ended": 400.0} if noted else {}
    tracking = {"kind": "sqlite", "uri": None}
    SweepPlan("s", {}, ["a=b"], cells, ["0" * 32], tracking, 1e9, **times).write(tmp_path)
    store = open_store("sqlite", None, tmp_path)
    assert refill(store, tmp_path) == 4
    assert refill(store, tmp_path) == 0
    (parent,) = [run for run in runs_in(store) if "sextant.sweep" in run.data.tags]
    assert parent.info.status == "FINISHED"
    assert (parent.info.start_time, parent.info.end_time) == ((90_000, 400_000) if noted else (100_000, 350_000))
    tied = {
        run.info.start_time: run.data.tags.get("mlflow.parentRunId")
        for run in runs_in(store)
        if run.info.run_id != parent.info.run_id
    }
    assert tied == {100_000: parent.info.run_id, 200_000: parent.info.run_id, 300_000: None}  # the third is another's


def test_a_parent_whose_sweep_was_killed_ends_when_its_last_run_did(tmp_path):
    made_up_run(tmp_path, 0)
    made_up_run(tmp_path, 1, finished=False)
    cells = [Cell({}, "run", seed, seed, "12345678", f"runs/classification/12345678-s{seed}") for seed in range(2)]
    plan = SweepPlan("s", {}, [], cells, [], {"kind": "sqlite", "uri": None}, began=90.0)
    store = open_store("sqlite", None, tmp_path)
    parent = store.client.create_run(store.experiment_id("e"), start_time=90_000).info.run_id
    SweepPlan(**{**plan.__dict__, "mlflow_runs": [parent]}).write(tmp_path)
    assert refill_parents(store, tmp_path) == 1
    found = store.client.get_run(parent)
    assert (found.info.status, found.info.end_time) == ("KILLED", 210_000)
    assert read_plan(find_sweep("s", tmp_path)).mlflow_runs == [parent]


def test_a_damaged_sweep_keeps_no_other_from_its_parent(tmp_path):
    made_up_run(tmp_path, 0)
    cell = Cell({}, "run", 0, 0, "12345678", "runs/classification/12345678-s0")
    for name in ("a", "s"):
        SweepPlan(name, {}, [], [cell]).write(tmp_path)
    damaged, store, said = find_sweep("a", tmp_path) / "cells.json", open_store("sqlite", None, tmp_path), Hears()
    damaged.write_text("{")
    assert refill(store, tmp_path, reporter=said) == 2
    (name,) = [run.info.run_name for run in runs_in(store) if "sextant.sweep" in run.data.tags]
    assert name == find_sweep("s", tmp_path).name.replace("-", " ")
    assert f"{damaged} is missing or damaged, and is skipped" in said.said


def killed(outputs, monkeypatch, *overrides):
    """A run whose process was ended by ``kill -9``: nothing was noted."""

    def interrupted(self, batch, batch_idx):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Classification, "training_step", interrupted)
        patch.setattr(life._Run, "_end", lambda *_: None)
        with pytest.raises(KeyboardInterrupt):
            execute(quick_config(outputs, *overrides))
    (directory,) = (outputs / "runs" / "classification").glob("*-s0")
    return RunDirectory(directory)


@pytest.mark.slow
def test_a_run_that_was_killed_is_ended_by_the_next_one_and_resumes(tmp_path, monkeypatch):
    run = killed(tmp_path, monkeypatch)
    store = open_store("sqlite", None, tmp_path)
    (found,) = runs_in(store, "classification")
    assert found.info.status == "RUNNING"
    execute(quick_config(tmp_path, "seed=1"))
    found = store.client.get_run(found.info.run_id)
    assert found.info.status == "KILLED"
    assert found.info.end_time == int(1000 * run.state()["started"])  # it had written nothing yet
    execute(quick_config(tmp_path, "trainer.log_every=20"))
    assert sorted(run.info.status for run in runs_in(store, "classification")) == ["FINISHED"] * 2
    assert store.client.get_run(found.info.run_id).data.params["trainer.max_epochs"] == "2"


@pytest.mark.slow
def test_the_command_of_a_finished_run_sends_what_the_store_did_not_get(tmp_path, monkeypatch):
    from mlflow import MlflowClient

    def away(*_, **__):
        raise OSError("the server is away")

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "set_terminated", away)
        execute(quick_config(tmp_path))
    store = open_store("sqlite", None, tmp_path)
    assert [run.info.status for run in runs_in(store, "classification")] == ["RUNNING"]
    assert execute(quick_config(tmp_path)).reused
    assert [run.info.status for run in runs_in(store, "classification")] == ["FINISHED"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["tracking=mlflow"], "tracking=mlflow must be one of sqlite, server"),
        (["tracking=server"], "tracking.uri=: must be the address of the server"),
        (["tracking=server", "tracking.uri=localhost:5000"], "tracking.uri=localhost:5000: must be the address"),
        (["tracking.uri=http://127.0.0.1:9"], "tracking.uri=http://127.0.0.1:9 belongs to tracking=server"),
        (["tracking=server", "tracking.uri=http://127.0.0.1:9", "port=5000"], "port=5000 belongs to tracking=sqlite"),
        (["tracking=server", "tracking.uri=http://127.0.0.1:9"], "no MLflow server answers there"),
    ],
)
def test_a_server_that_cannot_be_filled_is_told(tmp_path, capsys, arguments, says):
    with pytest.raises(SystemExit) as ended:
        cli.run("dashboard", [f"outputs={tmp_path}", *arguments])
    assert ended.value.code == 2
    assert says in capsys.readouterr().err.replace("\n", " ")
