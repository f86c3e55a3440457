"""MLflow mirrors the run directories, and can be made again from them."""

from contextlib import suppress

import pytest
from support import quick_config

from sextant.chapters.classification.task import Classification
from sextant.errors import LossNotFiniteError, UserError
from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory
from sextant.tracking.refill import refill
from sextant.tracking.store import open_store


@pytest.fixture(scope="module")
def run(outputs):
    return RunDirectory(execute(quick_config(outputs)).directory)


def mirrored(outputs, directory):
    store = open_store("sqlite", None, outputs)
    return store.client, store.client.get_run(directory.tracking_ids()[-1])


def content(client, run):
    history = {
        name: [(point.step, point.value) for point in client.get_metric_history(run.info.run_id, name)]
        for name in run.data.metrics
    }
    artifacts = {file.path for folder in ("", "figures") for file in client.list_artifacts(run.info.run_id, folder)}
    return run.info.status, run.data.params, history, artifacts


def test_a_finished_run_is_mirrored_whole(outputs, run):
    client, found = mirrored(outputs, run)
    status, params, history, artifacts = content(client, found)
    assert status == "FINISHED"
    assert params["optimizer.lr"] == "0.02"
    assert params["backbone.variant"] == "A"
    assert (params["backbone"], params["dataset"], params["seed"]) == ("LeNet", "Digits", "0")
    assert len(params) < 20 < len(run.state()["params"])  # all of them are in config.yaml
    results = run.results()
    for name, value in results["metrics"].items():
        assert found.data.metrics[name] == pytest.approx(value)
    assert all(len(points) == len(set(points)) for points in history.values())
    assert {"config.yaml", "metrics.json", "figures/contact_sheet.png"} <= artifacts
    assert found.data.tags["sextant.digest"] == results["digest"]
    assert found.data.tags["version.torch"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "status", "says"),
    [
        (["optimizer.lr=1e6"], "FAILED", "the training loss became nan at step"),
        (["optimizer.lr=1e-9", "trainer.max_epochs=1"], "FINISHED", "It did not learn."),
    ],
)
def test_a_run_that_diverged_says_so_in_its_description(outputs, overrides, status, says):
    config = quick_config(outputs, *overrides)
    with suppress(LossNotFiniteError):
        execute(config)
    _, found = mirrored(outputs, RunDirectory(execute(config).directory))
    assert found.info.status == status
    assert found.data.tags["mlflow.note.content"].startswith("This run diverged. ")
    assert says in found.data.tags["mlflow.note.content"]


@pytest.mark.slow
def test_nothing_lies_about_outside_the_output_folder(outputs, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    execute(quick_config(outputs, "seed=4"))
    assert list(tmp_path.iterdir()) == []


def test_a_deleted_database_is_made_again_from_the_run_directories(outputs, run):
    client, found = mirrored(outputs, run)
    before = content(client, found)
    for file in outputs.glob("mlflow.db*"):
        file.unlink()
    elsewhere = outputs.rename(outputs.with_name("moved"))  # another address, so that no open engine is used again
    try:
        store = open_store("sqlite", None, elsewhere)
        directory = RunDirectory(elsewhere / run.path.relative_to(outputs))
        assert refill(store, elsewhere) >= 1
        again = store.client.get_run(directory.tracking_ids()[-1])
        assert content(store.client, again) == before
        assert refill(store, elsewhere) == 0
    finally:
        elsewhere.rename(outputs)


@pytest.mark.slow
def test_a_failed_run_is_marked_failed_and_a_dead_one_killed(tmp_path, monkeypatch):
    def fails(self, batch, batch_idx):
        raise UserError("no")

    def interrupted(self, batch, batch_idx):
        raise KeyboardInterrupt

    for seed, (step, error, status) in enumerate(
        [(fails, UserError, "FAILED"), (interrupted, KeyboardInterrupt, "KILLED")]
    ):
        monkeypatch.setattr(Classification, "training_step", step)
        with pytest.raises(error):
            execute(quick_config(tmp_path, f"seed={seed}"))
        (path,) = (tmp_path / "runs" / "classification").glob(f"*-s{seed}")
        client, found = mirrored(tmp_path, RunDirectory(path))
        assert found.info.status == status
        client.update_run(found.info.run_id, status="RUNNING")  # as after kill -9
        assert refill(open_store("sqlite", None, tmp_path), tmp_path) == 1
        assert client.get_run(found.info.run_id).info.status == status


@pytest.mark.slow
def test_a_resumed_run_keeps_its_mlflow_run(tmp_path, monkeypatch):
    def interrupted(self, batch, batch_idx):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Classification, "training_step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            execute(quick_config(tmp_path))
    directory = RunDirectory(execute(quick_config(tmp_path)).directory)
    assert len(directory.tracking_ids()) == 1
    client, found = mirrored(tmp_path, directory)
    assert found.info.status == "FINISHED"
    assert len(client.search_runs([found.info.experiment_id])) == 1


@pytest.mark.slow
def test_a_store_that_fails_does_not_stop_the_run(tmp_path, monkeypatch, capsys):
    from mlflow import MlflowClient

    def down(*_, **__):
        raise OSError("the store is down")

    log_batch, calls = MlflowClient.log_batch, []

    def down_after_the_params(self, *args, **kwargs):
        calls.append(1)
        return log_batch(self, *args, **kwargs) if len(calls) < 3 else down()

    monkeypatch.setattr(MlflowClient, "log_batch", down_after_the_params)
    directory = RunDirectory(execute(quick_config(tmp_path)).directory)
    assert directory.results() is not None
    monkeypatch.undo()
    assert refill(open_store("sqlite", None, tmp_path), tmp_path) == 1
    _, found = mirrored(tmp_path, directory)
    assert found.info.status == "FINISHED"
    assert found.data.metrics["test/accuracy/clean"] == pytest.approx(
        directory.results()["metrics"]["test/accuracy/clean"]
    )
