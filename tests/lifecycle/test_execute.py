"""The life of a run, in one process."""

import json
import math
import re

import numpy as np
import pytest
import torch
import yaml
from support import quick_config

from sextant.chapters.classification.task import Classification
from sextant.composing.compose import compose, to_plain
from sextant.errors import UserError
from sextant.lifecycle import execute as life
from sextant.lifecycle.execute import execute, execute_cell
from sextant.lifecycle.run_reporter import RunReporter
from sextant.lifecycle.training import unfilled_tensors
from sextant.runs.checkpoint import KEY, load_checkpoint
from sextant.runs.directory import RunDirectory
from sextant.training.schedules import log_training_loss


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    outputs = tmp_path_factory.mktemp("outputs")
    raw = quick_config(outputs, "tracking=none")
    return raw, execute(raw)


def test_a_run_leaves_everything_in_its_directory(finished):
    raw, outcome = finished
    directory = RunDirectory(outcome.directory)
    assert outcome.directory.name.endswith("-s0")
    assert yaml.safe_load(directory.config.read_text()) == raw
    metrics = directory.results()["metrics"]
    conditions = ("clean", "gaussian/0.1", "contrast_poisson/0.5")
    by_condition = {f"test/{name}/{each}" for name in ("accuracy", "ece", "nll") for each in conditions}
    headline = ("clean", "corrupted", "relative_loss", "under/gaussian", "under/contrast_poisson")
    assert set(metrics) == {"val/accuracy", "val/loss", *by_condition, *(f"test/headline/{each}" for each in headline)}
    with np.load(directory.arrays, allow_pickle=False) as arrays:
        accuracy = (arrays["gaussian/0.1"] == arrays["labels"]).mean()
    assert metrics["test/accuracy/gaussian/0.1"] == pytest.approx(accuracy)
    names = {path.stem for path in directory.figures.iterdir()}
    assert names == {"severity_curves", "confusion_matrix", "contact_sheet", "first_kernels"}
    assert directory.state()["provenance"]["versions"]["torch"]


def test_the_checkpoint_is_plain_and_carries_the_config(finished):
    raw, outcome = finished
    content = load_checkpoint(RunDirectory(outcome.directory).last_checkpoint)
    assert content[KEY]["config"] == raw
    assert content[KEY]["spec"]["classes"] == list("0123456789")


def test_new_tensors_are_not_filled_while_a_network_is_trained(finished):
    assert torch.utils.deterministic.fill_uninitialized_memory  # the user's own setting
    with unfilled_tensors():
        assert not torch.utils.deterministic.fill_uninitialized_memory
    assert torch.utils.deterministic.fill_uninitialized_memory


def test_the_same_again_returns_the_finished_run(finished):
    raw, outcome = finished
    before = RunDirectory(outcome.directory).metrics.stat().st_mtime_ns
    again = execute(raw)
    assert again.reused
    assert again.directory == outcome.directory
    assert RunDirectory(outcome.directory).metrics.stat().st_mtime_ns == before


def test_a_missing_device_is_told_before_there_is_a_directory(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(UserError, match="no CUDA device was found"):
        execute(quick_config(tmp_path, "tracking=none", "trainer=gpu"))
    assert not list(tmp_path.glob("runs/*/[!.]*"))


def test_a_distribution_of_cameras_that_is_none_is_refused_before_there_is_a_directory(tmp_path):
    raw = to_plain(compose(["task=calibration", "sampling.tilt=abc", f"paths.outputs={tmp_path}"]))
    with pytest.raises(UserError, match=r"^sampling\.tilt='abc' is not a distribution"):
        execute(raw)
    assert not list(tmp_path.iterdir())


def test_a_finished_run_needs_no_device(finished, monkeypatch):
    def refuse(config, source):
        raise UserError("no device")

    monkeypatch.setattr(life, "require_possible", refuse)
    assert execute(finished[0]).reused
    with pytest.raises(UserError, match="no device"):
        execute({**finished[0], "seed": 1})


@pytest.mark.slow
def test_changed_code_runs_into_a_new_directory_with_the_same_result(finished, monkeypatch):
    raw, outcome = finished
    monkeypatch.setattr(life, "source_sha256", lambda targets: "other code")
    again = execute(raw)
    assert again.directory.name == outcome.directory.name + "-2"
    assert RunDirectory(again.directory).results()["metrics"] == RunDirectory(outcome.directory).results()["metrics"]
    assert execute({**raw, "reuse": "any_code"}).directory == outcome.directory


def weights(outcome):
    return load_checkpoint(RunDirectory(outcome.directory).last_checkpoint)["state_dict"]


@pytest.mark.slow
def test_interrupted_and_resumed_equals_uninterrupted_bit_for_bit(tmp_path, monkeypatch):
    overrides = ["trainer.max_epochs=4", "inhibition=push_pull", "trainer.log_every=20"]
    overrides += ["tracking=none", "tracking.also=[csv]"]
    whole = execute(quick_config(tmp_path / "whole", *overrides))
    steps = RunDirectory(whole.directory).results()["steps"]
    third_epoch, interruption = steps // 2, steps // 2 + 20
    training_step, seen = Classification.training_step, []

    def interrupted_in_the_third_epoch(self, batch, batch_idx):
        seen.append(self.global_step)
        if len(seen) == interruption:
            raise KeyboardInterrupt
        return training_step(self, batch, batch_idx)

    monkeypatch.setattr(Classification, "training_step", interrupted_in_the_third_epoch)
    raw = quick_config(tmp_path / "parts", *overrides)
    with pytest.raises(KeyboardInterrupt):
        execute(raw)
    resumed = execute(raw)
    assert seen[interruption:] == list(range(third_epoch, steps))  # it went on from the last whole epoch
    assert RunDirectory(resumed.directory).results()["metrics"] == RunDirectory(whole.directory).results()["metrics"]
    one, other = weights(whole), weights(resumed)
    assert all(torch.equal(one[name], other[name]) for name in one)

    def train_losses(outcome):
        lines = map(json.loads, RunDirectory(outcome.directory).history.read_text().splitlines())
        return [(x["step"], x["metrics"]["train/loss"]) for x in lines if "train/loss" in x["metrics"]]

    assert train_losses(whole) == train_losses(resumed)
    table, same = ((each.directory / "csv" / "metrics.csv").read_text() for each in (whole, resumed))
    assert table == same
    assert len(table.splitlines()) > steps / 20


@pytest.mark.slow
def test_the_training_time_of_a_resumed_run_counts_its_first_part(tmp_path, monkeypatch):
    training_step = Classification.training_step

    def interrupted_in_the_second_epoch(self, batch, batch_idx):
        if self.trainer.current_epoch == 1:
            raise KeyboardInterrupt
        return training_step(self, batch, batch_idx)

    with monkeypatch.context() as patch:
        patch.setattr(Classification, "training_step", interrupted_in_the_second_epoch)
        with pytest.raises(KeyboardInterrupt):
            execute(quick_config(tmp_path, "tracking=none"))
    (run,) = map(RunDirectory, (tmp_path / "runs" / "classification").glob("*-s0"))
    first = run.state()["trained_s"]
    assert first > 0
    run.update_state({"trained_s": first + 1e6})
    execute(quick_config(tmp_path, "tracking=none"))
    assert run.results()["timing"]["fit_s"] > first + 1e6


@pytest.mark.slow
def test_an_interrupted_run_says_so_and_is_resumable(tmp_path, monkeypatch):
    def interrupt(self, batch, batch_idx):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Classification, "training_step", interrupt)
        with pytest.raises(KeyboardInterrupt):
            execute(quick_config(tmp_path, "tracking=none"))
    (run,) = (tmp_path / "runs" / "classification").glob("*-s0")
    assert RunDirectory(run).state()["failure"] == "interrupted"
    assert RunDirectory(run).results() is None
    resumed = execute(quick_config(tmp_path, "tracking=none"))
    assert resumed.directory == run
    assert RunDirectory(run).state()["failure"] is None
    assert RunDirectory(run).results()["epochs"] == 2


def nan_at_step_25(self, batch, batch_idx):
    loss = torch.nn.functional.cross_entropy(self(batch.images_in_unit_range()), batch.labels)
    loss = loss * (math.nan if self.global_step == 25 else 1.0)
    log_training_loss(self, self.step_losses.add(self.global_step, loss))
    return loss


@pytest.mark.slow
def test_a_nan_loss_stops_the_run_and_names_the_step(tmp_path, monkeypatch):
    monkeypatch.setattr(Classification, "training_step", nan_at_step_25)
    raw = quick_config(tmp_path, "tracking=none")
    with pytest.raises(UserError, match="became nan at step 25"):
        execute(raw)
    (run,) = (tmp_path / "runs" / "classification").glob("*-s0")
    assert "step 25" in RunDirectory(run).state()["failure"]
    assert RunDirectory(run).results()["outcome"] == "diverged"
    cell = execute_cell(raw)  # the same nan is not looked for again
    assert (cell["status"], cell["reused"]) == ("diverged", True)
    assert "step 25" in cell["message"]
    other = execute_cell({**raw, "seed": 1})
    assert (other["status"], other["reused"]) == ("diverged", False)


class Told(RunReporter):
    """Keeps what is said."""

    def __init__(self):
        self.said = []

    def say(self, text):
        self.said.append(text)


def test_a_failing_cell_is_an_outcome_and_not_an_exception(tmp_path):
    raw = quick_config(tmp_path, "tracking=none", "dataset=image_folder", "dataset.folder=/nowhere")
    told = Told()
    cell = execute_cell(raw, told)
    assert cell["status"] == "failed"
    assert "no such folder" in cell["message"]
    (said,) = told.said
    assert re.fullmatch(r"classification/[0-9a-f]{8}-s0 failed: UserError: .*", said, re.DOTALL)
    assert cell["message"] in said


def test_a_fault_of_the_program_leaves_its_traceback_until_the_run_is_tried_again(tmp_path, monkeypatch):
    raw, told = quick_config(tmp_path, "tracking=none"), Told()
    monkeypatch.setattr(Classification, "configure_optimizers", lambda self: 1 / 0)
    assert execute_cell(raw, told)["status"] == "failed"
    (run,) = (tmp_path / "runs" / "classification").glob("*-s0")
    assert "ZeroDivisionError" in RunDirectory(run).traceback.read_text()
    assert told.said[-2:] == [
        f"the traceback is in {RunDirectory(run).traceback}",
        f"classification/{run.name} failed: ZeroDivisionError: division by zero",
    ]
    monkeypatch.undo()
    assert execute_cell(raw)["status"] != "failed"
    assert not RunDirectory(run).traceback.exists()


@pytest.mark.slow
def test_the_best_checkpoint_is_chosen_on_validation(tmp_path):
    raw = quick_config(tmp_path, "tracking=none", "task.test_checkpoint=best", "trainer.max_epochs=4")
    directory = RunDirectory(execute(raw).directory)
    validation = [
        line["metrics"]["val/accuracy"]
        for line in map(json.loads, directory.history.read_text().splitlines())
        if "val/accuracy" in line["metrics"]
    ]
    assert directory.results()["metrics"]["val/accuracy"] == pytest.approx(max(validation))


@pytest.mark.slow
def test_the_best_checkpoint_survives_an_interruption_and_a_move(tmp_path, monkeypatch):
    overrides = ["tracking=none", "task.test_checkpoint=best", "trainer.max_epochs=6", "optimizer.lr=0.3"]
    whole = execute(quick_config(tmp_path / "whole", *overrides))
    steps = RunDirectory(whole.directory).results()["steps"] // 6
    training_step, seen = Classification.training_step, []

    def interrupted_in_the_fourth_epoch(self, batch, batch_idx):
        seen.append(self.global_step)
        if len(seen) == 3 * steps + 5:
            raise KeyboardInterrupt
        return training_step(self, batch, batch_idx)

    monkeypatch.setattr(Classification, "training_step", interrupted_in_the_fourth_epoch)
    with pytest.raises(KeyboardInterrupt):
        execute(quick_config(tmp_path / "before", *overrides))
    (tmp_path / "before").rename(tmp_path / "after")
    resumed = execute(quick_config(tmp_path / "after", *overrides))
    assert seen[3 * steps + 5] == 3 * steps
    assert RunDirectory(resumed.directory).results()["metrics"] == RunDirectory(whole.directory).results()["metrics"]
    best = [load_checkpoint(RunDirectory(o.directory).best_checkpoint) for o in (whole, resumed)]
    assert best[0]["epoch"] == best[1]["epoch"]
    assert all(torch.equal(best[0]["state_dict"][name], best[1]["state_dict"][name]) for name in best[0]["state_dict"])


@pytest.mark.slow
def test_training_starts_from_the_weights_of_another_run(finished, tmp_path):
    _, outcome = finished
    fresh = execute(quick_config(tmp_path, "tracking=none"))
    from_run = execute(quick_config(tmp_path, "tracking=none", f"init_from={outcome.directory}", "seed=0"))
    assert from_run.directory != fresh.directory
    losses = [RunDirectory(o.directory).results()["metrics"]["val/loss"] for o in (fresh, from_run)]
    assert losses[1] < losses[0]


def test_weights_that_do_not_fit_are_refused(finished, tmp_path):
    _, outcome = finished
    raw = quick_config(tmp_path, "tracking=none", "backbone=lenet_b", f"init_from={outcome.directory}")
    with pytest.raises(UserError, match="do not fit this network"):
        execute(raw)


@pytest.mark.slow
def test_the_twin_is_the_convolution_and_the_push_pull_layer_is_not(finished, tmp_path):
    _, conv = finished
    twin = execute(quick_config(tmp_path, "tracking=none", "inhibition=twin"))
    push_pull = execute(quick_config(tmp_path, "tracking=none", "inhibition=push_pull"))
    results = [RunDirectory(o.directory).results()["metrics"] for o in (conv, twin, push_pull)]
    assert results[0] == results[1] != results[2]
    assert all(torch.equal(a, b) for a, b in zip(weights(conv).values(), weights(twin).values(), strict=True))
