"""The page of a sweep in MLflow: what it asks, how far it is, what it found; and names that tell its runs apart."""

import shutil
from dataclasses import replace

import pytest
from made_up_sweep import MadeUpRun, made_up_sweep

from sextant.cli.dashboard import PAGE
from sextant.lifecycle.parent_page import ParentPage
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.reports.sweep_page import MOST_EFFECTS, Progress, sweep_page
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import read_plan
from sextant.tracking.store import open_store
from sextant.tracking.sweep_parent import open_parent, refill_parents, run_name

QUESTION = "Does it help?"
#: of a run; a list of runs shows but a few of such
PARAMS = {
    "seed": 3, "inhibition._target_": "sextant.layers.PushPullInhibition", "inhibition.scale": 2.0,
    "backbone._target_": "sextant.models.LeNet", "backbone.variant": "A", "trainer.log_every": 50,
    "inhibition.alpha": 1.0,
}  # fmt: skip


def sweep_in(folder, **definition):
    arms = {
        "conv": [MadeUpRun({"clean": 4 + k % 2, "noise": 8}, protocol=None) for k in range(8)],
        "push_pull": [MadeUpRun({"clean": 2, "noise": 5 + k % 2}, protocol=None) for k in range(8)],
    }
    contrasts = {"effect": {"treatment": "push_pull", "control": "conv"}}
    return made_up_sweep(folder, arms, question=QUESTION, contrasts=contrasts, **definition)


class Hears(RunReporter):
    """Keeps what is said."""

    def __init__(self):
        self.said = []

    def say(self, message):
        self.said.append(message)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The client, the parent run and the children of a sweep whose page was written."""
    outputs = tmp_path_factory.mktemp("outputs")
    plan = sweep_in(outputs).plan
    plan.definition["arms"] = {"conv": {"overrides": []}, "push_pull": {"overrides": ["inhibition.scale=2"]}}
    store = open_store("sqlite", None, outputs)
    experiment = store.experiment_id("classification")
    for cell in plan.cells:
        child = store.client.create_run(experiment, run_name="05e71b0b-s0")
        RunDirectory(outputs / cell.run).update_state({"mlflow_runs": [child.info.run_id], "params": PARAMS})
    parent = open_parent("sqlite", None, outputs, plan, "classification")
    ParentPage(parent, plan, outputs, SILENT_RUN).end(plan)
    children = [store.client.get_run(RunDirectory(outputs / cell.run).tracking_ids()[-1]) for cell in plan.cells]
    return store.client, store.client.get_run(parent.run_id), children


def test_the_parent_has_the_question_the_command_and_what_was_found(written):
    client, parent, _ = written
    text = parent.data.tags["mlflow.note.content"]
    assert parent.info.run_name == "made_up"
    for expected in (QUESTION, "16 of 16 runs have ended", "sextant report sweep=made_up-", "| effect | net | clean |"):
        assert expected in text
    (picture,) = [file.path for file in client.list_artifacts(parent.info.run_id, "page")]
    assert picture == "page/contrast_effect.png"
    assert f"![contrast](get-artifact?path=page%2Fcontrast_effect.png&run_uuid={parent.info.run_id})" in text


def test_the_parent_has_metrics_params_and_tags_of_its_own(written):
    _, parent, _ = written
    metrics = parent.data.metrics
    assert metrics["effect/net clean"] == pytest.approx(12.5)
    assert metrics["low/net clean"] < 12.5 < metrics["high/net clean"]
    assert 0 < metrics["p/net clean"] < 0.05
    assert (metrics["runs/done"], metrics["runs/planned"], metrics["runs/failed"]) == (16, 16, 0)
    assert parent.data.params["arms"] == "conv, push_pull"
    assert parent.data.tags["task"] == "classification"


def test_runs_are_named_by_arm_setting_and_seed(written):
    names = [child.info.run_name for child in written[2]]
    assert names[0] == "conv net seed 0"
    assert names[-1] == "push_pull net seed 7"
    assert written[2][0].data.tags["arm"] == "conv"
    assert QUESTION in written[2][0].data.tags["mlflow.note.content"]
    assert run_name(["full", "pooled"], "-", 3) == "full + pooled seed 3"


def test_runs_have_the_few_params_that_identify_them_or_are_compared(written):
    assert written[2][0].data.params == {
        "seed": "3", "inhibition": "PushPullInhibition", "inhibition.scale": "2.0", "backbone": "LeNet",
        "backbone.variant": "A",
    }  # fmt: skip


def test_an_experiment_is_one_of_models_that_are_trained_and_says_what_it_holds(tmp_path):
    store = open_store("sqlite", None, tmp_path)
    old = store.client.create_experiment("calibration")
    store.client.set_experiment_tag(old, "mlflow.note.content", "my own words")
    for name, words in (("classification", "Push-pull"), ("calibration", "my own words"), ("mine", "Runs of Sextant")):
        tags = store.client.get_experiment(store.experiment_id(name)).tags
        assert tags["mlflow.experimentKind"] == "custom_model_development"
        assert words in tags["mlflow.note.content"]
    assert PAGE.endswith("workflowType=machine_learning")


def test_a_page_before_the_first_run_has_ended_says_so_and_failures_are_told(tmp_path):
    plan = sweep_in(tmp_path).plan
    page = sweep_page(plan, Progress(3, 16, {"runs/a/b": "out of memory"}, 780.0), None)
    assert "3 of 16 runs have ended, some 13 minutes left" in page.text
    assert "- `runs/a/b`: out of memory" in page.text
    assert page.metrics == {"runs/done": 3, "runs/planned": 16, "runs/failed": 1, "minutes_left": 13}


def test_metrics_of_a_page_are_few_and_have_names_that_mlflow_takes(tmp_path):
    conditions = {f"R@1 (deg) {k}": k % 5 for k in range(30)}
    arms = {arm: [MadeUpRun(conditions, protocol=None) for _ in range(3)] for arm in ("a", "b")}
    results = made_up_sweep(tmp_path, arms, contrasts={"x": {"treatment": "a", "control": "b"}})
    metrics = sweep_page(results.plan, Progress(6, 6), results).metrics
    assert len([name for name in metrics if name.startswith("effect/")]) == MOST_EFFECTS
    assert not any(set(name) & set("@()") for name in metrics)


def test_a_page_that_cannot_be_written_is_told_once_and_stops_nothing(tmp_path):
    plan, hears = sweep_in(tmp_path).plan, Hears()
    parent = open_parent("sqlite", None, tmp_path, plan, "classification")
    page = ParentPage(parent, plan, tmp_path, hears)
    (plan.directory(tmp_path) / "cells.json").write_text("{")
    page.parent = None
    page.end(plan)
    page.end(plan)
    assert len(hears.said) == 1
    assert "the page of the sweep could not be written" in hears.said[0]


def test_a_store_that_is_filled_anew_has_the_page_again(tmp_path):
    outputs, other = tmp_path / "outputs", tmp_path / "other"
    plan = sweep_in(outputs).plan
    parent = open_parent("sqlite", None, outputs, plan, "classification")
    plan = replace(plan, mlflow_runs=[parent.run_id])
    plan.write(outputs)
    ParentPage(parent, plan, outputs, SILENT_RUN).end(plan)
    shutil.copytree(outputs, other, ignore=shutil.ignore_patterns("mlflow.db*", "artifacts"))
    store = open_store("sqlite", None, other)
    assert refill_parents(store, other) == 1
    again = store.client.get_run(read_plan(plan.directory(other)).mlflow_runs[-1])
    assert again.info.run_id != parent.run_id
    assert f"run_uuid={again.info.run_id})" in again.data.tags["mlflow.note.content"]
    assert again.data.metrics["effect/net clean"] == pytest.approx(12.5)
    assert store.client.list_artifacts(again.info.run_id, "page")
