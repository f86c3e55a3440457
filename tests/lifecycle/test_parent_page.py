"""The page of a sweep in MLflow: what it asks, how far it is, what it found; and names that tell its runs apart."""

import shutil
from dataclasses import asdict, replace

import numpy as np
import pytest
from made_up_search import code_and_data
from made_up_sweep import MadeUpRun, made_up_sweep
from support import Hears

from sextant.atomic_files import read_json, write_json
from sextant.cli.dashboard import PAGE
from sextant.lifecycle.parent_page import ParentPage, fill_store, write_page
from sextant.lifecycle.run_reporter import SILENT_RUN
from sextant.lifecycle.sweep import run_sweep
from sextant.reports.sweep_page import MOST_EFFECTS, Progress, sweep_page
from sextant.runs.directory import RunDirectory, RunKey
from sextant.runs.sweep_directory import find_sweep, read_plan
from sextant.tracking.store import open_store
from sextant.tracking.sweep_parent import label_cells, open_parent, refill_parents, run_name

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
    assert parent.info.run_name == f"made_up {parent.data.tags['sextant.sweep'][-8:]}: conv, push_pull"
    for expected in (
        QUESTION,
        "16 of 16 runs have ended, 0 of them diverged",
        "sextant report sweep=made_up-",
        "| effect | net | clean |",
    ):
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
    assert metrics["runs/diverged"] == 0
    assert parent.data.params["arms"] == "conv, push_pull"
    assert parent.data.tags["task"] == "classification"


def test_runs_are_named_by_arm_setting_and_seed(written):
    names = [child.info.run_name for child in written[2]]
    assert names[0] == "conv net seed 0 (conv)"
    assert names[-1] == "push_pull net seed 7 (push_pul)"
    assert written[2][0].data.tags["arm"] == "conv"
    assert QUESTION in written[2][0].data.tags["mlflow.note.content"]
    assert run_name(["full", "pooled"], "-", 3, "05e71b0bffff") == "full + pooled seed 3 (05e71b0b)"


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
    page, metrics = sweep_page(plan, Progress(3, 16, {"runs/a/b": "out of memory"}, 780.0), None, tmp_path)
    assert "3 of 16 runs have ended, 0 of them diverged; about 13 minutes left" in page
    assert "- `runs/a/b`: out of memory" in page
    assert metrics == {
        "runs/done": 3,
        "runs/planned": 16,
        "runs/failed": 1,
        "runs/diverged": 0,
        "minutes_left": 13,
    }


def test_metrics_of_a_page_are_few_and_have_names_that_mlflow_takes(tmp_path):
    conditions = {f"R@1 (deg) {k}": k % 5 for k in range(30)}
    arms = {arm: [MadeUpRun(conditions, protocol=None) for _ in range(3)] for arm in ("a", "b")}
    results = made_up_sweep(tmp_path, arms, contrasts={"x": {"treatment": "a", "control": "b"}})
    _, metrics = sweep_page(results.plan, Progress(6, 6), results, tmp_path)
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


@pytest.mark.slow
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


def test_each_figure_of_a_page_has_a_title(tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr(
        "sextant.figures.style.save_figure",
        lambda figure, folder, name: [drawn.update({name: figure.get_suptitle()}) or folder / f"{name}.png"],
    )
    write_page(sweep_in(tmp_path).plan, tmp_path)
    assert drawn == {"contrast_effect": "effect: push_pull minus conv"}


def as_an_earlier_version_left_it(store, outputs, plan):
    """Take from a store, and from the page of its sweep, what earlier versions did not write."""
    parent, children = parent_and_children(store, outputs, plan)
    store.client.set_tag(parent.info.run_id, "mlflow.runName", plan.title)
    page = plan.directory(outputs) / "page.json"
    write_json(page, read_json(page) | {"own_tags": {"sextant.outcome": "16 finished"}, "text": "of before"})
    store.client.set_tag(parent.info.run_id, "mlflow.note.content", "of before")
    store.client.delete_tag(parent.info.run_id, "sextant.page")
    for number, child in enumerate(children):
        note = "my own words" if number == 0 else f"This run diverged. {number}" if number == 1 else ""
        store.client.set_tag(child.info.run_id, "mlflow.note.content", note)
        store.client.set_tag(child.info.run_id, "mlflow.runName", f"conv net seed {number}")
        store.client.delete_tag(child.info.run_id, "sextant.result")


@pytest.mark.slow
def test_a_store_of_an_earlier_version_is_brought_up_to_date_once(tmp_path):
    plan = replace(sweep_in(tmp_path).plan, tracking={"kind": "none", "uri": None}, began=90.0, ended=300.0)
    plan.write(tmp_path)
    for cell in plan.cells:
        path = RunDirectory(tmp_path / cell.run).metrics
        write_json(path, read_json(path) | {"metrics": {"val/accuracy": 0.8, "test/accuracy/clean": 0.75}})
    end_runs(tmp_path, plan, tracking=None)
    store = open_store("sqlite", None, tmp_path)
    fill_store(store, tmp_path, SILENT_RUN)
    as_an_earlier_version_left_it(store, tmp_path, plan)
    assert fill_store(store, tmp_path, SILENT_RUN) == 16 + 1
    assert fill_store(store, tmp_path, SILENT_RUN) == 0
    parent, children = parent_and_children(store, tmp_path, plan)
    assert parent.info.run_name == f"made_up {plan.digest[:8]}"
    assert "16 of 16 runs have ended, 0 of them diverged" in parent.data.tags["mlflow.note.content"]
    for child in children:
        assert child.info.run_name.endswith(f"({child.data.tags['arm'][:8]})")
        assert child.data.tags["sextant.result"] == "test/accuracy/clean = 0.75"
        assert child.data.tags["mlflow.note.content"].startswith("**test/accuracy/clean = 0.75**")


def end_runs(outputs, plan, metrics_of=lambda cell: {}, **state):
    """What the runs of a sweep leave that end while no process waits for them."""
    for cell in plan.cells:
        run, key = RunDirectory(outputs / cell.run), RunKey("classification", cell.digest, cell.seed, *code_and_data())
        began = {"experiment": "classification", "started": 100.0, "ended": 200.0 + cell.seed, "params": PARAMS}
        run.update_state(asdict(key) | began | state)
        if not run.metrics.exists():
            np.savez_compressed(run.arrays, labels=np.zeros(4, np.uint8), clean=np.arange(4, dtype=np.uint8) % 2)
            found = {"outcome": "finished", "metrics": metrics_of(cell), "parameters": 1, "timing": {"fit_s": 1.0}}
            write_json(run.metrics, found | asdict(key))


def parent_and_children(store, outputs, plan):
    """The parent run of a sweep, and the runs below it."""
    runs = store.client.search_runs([store.experiment_id("classification")])
    (parent,) = [run for run in runs if run.data.tags.get("sextant.sweep") == plan.directory(outputs).name]
    return parent, [run for run in runs if run.data.tags.get("mlflow.parentRunId") == parent.info.run_id]


@pytest.mark.slow
def test_a_sweep_that_was_not_tracked_has_its_parent_once_a_store_is_filled(tmp_path):
    plan = replace(sweep_in(tmp_path).plan, tracking={"kind": "none", "uri": None}, began=90.0, ended=300.0)
    plan.write(tmp_path)
    end_runs(tmp_path, plan, tracking=None)
    store = open_store("sqlite", None, tmp_path)
    assert fill_store(store, tmp_path, SILENT_RUN) == 16 + 1
    parent, children = parent_and_children(store, tmp_path, plan)
    assert (parent.info.run_name, parent.info.status) == (f"made_up {plan.digest[:8]}", "FINISHED")
    assert (parent.info.start_time, parent.info.end_time) == (90_000, 300_000)
    assert "16 of 16 runs have ended" in parent.data.tags["mlflow.note.content"]
    assert parent.data.metrics["effect/net clean"] == pytest.approx(12.5)
    assert parent.data.params["arms"] == "conv, push_pull"
    assert store.client.list_artifacts(parent.info.run_id, "page")
    names = {f"{arm} net seed {k} ({arm[:8]})" for arm in ("conv", "push_pull") for k in range(8)}
    assert {run.info.run_name for run in children} == names
    assert {run.data.tags["arm"] for run in children} == {"conv", "push_pull"}
    assert read_plan(plan.directory(tmp_path)).tracking == {"kind": "sqlite", "uri": None}  # a report goes there too
    assert fill_store(store, tmp_path, SILENT_RUN) == 0


@pytest.mark.parametrize(
    ("diverged", "status", "outcome", "told"),
    [
        (4, "FAILED", "4 diverged", "None of the runs learnt"),
        (1, "FINISHED", "3 finished, 1 diverged", "1 of 4 runs did not learn"),
        (0, "FINISHED", "4 finished", None),
    ],
)
def test_runs_that_did_not_learn_are_seen_in_the_store(tmp_path, diverged, status, outcome, told):
    runs = [MadeUpRun({"clean": 2}, "diverged" if k < diverged else "finished", protocol=None) for k in range(4)]
    plan = made_up_sweep(tmp_path, {"conv": runs[:2], "push_pull": runs[2:]}).plan
    plan = replace(plan, tracking={"kind": "none", "uri": None}, began=90.0, ended=300.0)
    plan.write(tmp_path)
    end_runs(tmp_path, plan, tracking=None)
    store = open_store("sqlite", None, tmp_path)
    assert fill_store(store, tmp_path, SILENT_RUN) == 4 + 1
    parent, children = parent_and_children(store, tmp_path, plan)
    page = parent.data.tags["mlflow.note.content"]
    assert (parent.info.status, parent.data.tags["sextant.outcome"]) == (status, outcome)
    assert f"4 of 4 runs have ended, {diverged} of them diverged." in page
    assert parent.data.metrics["runs/diverged"] == diverged
    assert told is None or f"**{told}.**" in page
    assert ("did not learn" in page or "learnt" in page) == bool(told)
    assert sum(run.data.tags["sextant.outcome"] == "diverged" for run in children) == diverged


@pytest.mark.slow
def test_a_run_of_two_sweeps_that_were_not_tracked_is_a_child_of_the_first(tmp_path):
    later = replace(sweep_in(tmp_path).plan, began=90.0, ended=300.0, tracking={"kind": "none"})
    earlier = replace(later, name="zoo", cells=later.cells[:3], began=80.0)
    for plan in (later, earlier):
        plan.write(tmp_path)
        end_runs(tmp_path, plan)
    store = open_store("sqlite", None, tmp_path)
    fill_store(store, tmp_path, SILENT_RUN)
    assert [len(parent_and_children(store, tmp_path, plan)[1]) for plan in (earlier, later)] == [3, 13]


def test_a_run_stays_with_the_sweep_that_used_it_first(tmp_path):
    first = sweep_in(tmp_path).plan
    first = replace(first, cells=first.cells[:1])
    second = replace(first, name="again", cells=[replace(first.cells[0], arm="other")])
    store = open_store("sqlite", None, tmp_path)
    child = store.client.create_run(store.experiment_id("classification"), run_name="05e71b0b-s0").info.run_id
    RunDirectory(tmp_path / first.cells[0].run).update_state({"mlflow_runs": [child], "params": PARAMS})
    parents = [open_parent("sqlite", None, tmp_path, plan, "classification") for plan in (first, second)]
    for parent, plan in zip(parents, (first, second), strict=True):
        assert label_cells(parent, plan, tmp_path) == {first.cells[0].run}
    found = store.client.get_run(child)
    assert (found.info.run_name, found.data.tags["sweep"]) == ("conv net seed 0 (conv)", "made_up")
    assert found.data.tags["mlflow.parentRunId"] == parents[0].run_id


def submitted_and_left(outputs):
    """The command of a sweep whose runs are submitted; its plan."""
    command = ["task=classification", "optimizer.lr=0.1,0.2", "seed=0,1", f"paths.outputs={outputs}"]
    outcome = run_sweep(command, run_cells=lambda cells: [None] * len(cells))
    assert outcome.count("submitted") == 4
    return command, read_plan(find_sweep("sweep", outputs))


@pytest.mark.slow
def test_the_page_of_a_sweep_that_was_left_ends_when_its_command_is_repeated(tmp_path):
    command, plan = submitted_and_left(tmp_path)
    store = open_store("sqlite", None, tmp_path)
    parent, _ = parent_and_children(store, tmp_path, plan)
    assert (parent.info.status, parent.data.metrics["runs/done"]) == ("RUNNING", 0)
    own = {"kind": "sqlite", "uri": None, "parent_run": parent.info.run_id, "log_checkpoint": False, "sent": False}
    end_runs(tmp_path, plan, tracking=own)
    run_sweep(command, run_cells=lambda cells: pytest.fail("nothing is missing"))
    parent, children = parent_and_children(store, tmp_path, plan)
    assert (parent.info.status, parent.info.end_time) == ("FINISHED", 201_000)
    assert "4 of 4 runs have ended" in parent.data.tags["mlflow.note.content"]
    assert parent.data.metrics["runs/done"] == 4
    assert {run.info.run_name for run in children} == {
        f"{cell.arm} seed {cell.seed} ({cell.digest[:8]})" for cell in plan.cells
    }


@pytest.mark.slow
@pytest.mark.parametrize("before", ["RUNNING", "FINISHED"])
def test_the_page_of_a_sweep_that_was_left_ends_when_the_store_is_filled(before, tmp_path):
    """Also of one whose parent was ended by a refill that left the page as it was."""
    plan = replace(sweep_in(tmp_path).plan, tracking={"kind": "sqlite", "uri": None}, began=90.0)
    parent = open_parent("sqlite", None, tmp_path, plan, "classification")
    plan = replace(plan, mlflow_runs=[parent.run_id])
    plan.write(tmp_path)
    for cell in plan.cells:
        RunDirectory(tmp_path / cell.run).metrics.rename(tmp_path / cell.run / "later")
    ParentPage(parent, plan, tmp_path, SILENT_RUN).look()
    parent.status(before)
    for cell in plan.cells:
        (tmp_path / cell.run / "later").rename(RunDirectory(tmp_path / cell.run).metrics)
    end_runs(tmp_path, plan, tracking={"kind": "sqlite", "uri": None, "sent": False, "log_checkpoint": False})
    store = open_store("sqlite", None, tmp_path)
    assert store.client.get_run(parent.run_id).data.metrics["runs/done"] == 0
    fill_store(store, tmp_path, SILENT_RUN)
    found, children = parent_and_children(store, tmp_path, plan)
    assert (found.info.run_id, found.info.status) == (parent.run_id, "FINISHED")
    assert "16 of 16 runs have ended" in found.data.tags["mlflow.note.content"]
    assert found.data.metrics["effect/net clean"] == pytest.approx(12.5)
    assert len(children) == 16
    assert fill_store(store, tmp_path, SILENT_RUN) == 0
