"""Sweeps in one process."""

import json
import sys

import pytest
from hydra.core.global_hydra import GlobalHydra
from PIL import Image
from support import QUICK

from sextant import cli
from sextant.runs.sweep_directory import find_sweep, read_plan
from sextant.tracking.store import open_store

pytestmark = pytest.mark.slow  # each runs a sweep to its end, and the second reads what the first has run


@pytest.fixture
def sweep(monkeypatch, capsys):
    def run(outputs, *arguments):
        monkeypatch.setenv("SEXTANT_OUTPUTS", str(outputs))
        monkeypatch.setattr(sys, "argv", ["train.py"])
        GlobalHydra.instance().clear()
        status = 0
        try:
            cli.run("train", ["-m", *QUICK, "trainer.batch_size=8", *arguments])  # in larger ones they learn nothing
        except SystemExit as exit_:
            status = exit_.code
        finally:
            GlobalHydra.instance().clear()
        return status, capsys.readouterr().out

    return run


FACTORS = ("backbone=lenet_a,lenet_b", "inhibition=none,push_pull", "seed=0,1")


def test_a_sweep_runs_every_cell_once_and_then_only_what_is_missing(outputs, sweep):
    status, text = sweep(outputs, "backbone=lenet_a", *FACTORS[1:])
    assert (status, "4 runs planned, 0 finished already" in text) == (0, True)
    status, text = sweep(outputs, *FACTORS)
    assert (status, "8 runs planned, 4 finished already" in text) == (0, True)
    status, text = sweep(outputs, *FACTORS)
    assert (status, "8 runs planned, 8 finished already" in text) == (0, True)

    plan = read_plan(find_sweep("sweep", outputs))
    assert len({cell.run for cell in plan.cells}) == 8
    assert {cell.setting for cell in plan.cells} == {"lenet_a", "lenet_b"}
    assert [cell.arm for cell in plan.cells[:4]] == ["none"] * 2 + ["push_pull"] * 2

    store = open_store("sqlite", None, outputs)
    runs = store.client.search_runs([store.experiment_id("classification")])
    parents = [run for run in runs if "sextant.sweep" in run.data.tags]
    children = [run for run in runs if "sextant.run" in run.data.tags]
    assert (len(parents), len(children)) == (2, 8)
    assert all(run.info.status == "FINISHED" for run in runs)
    assert {run.data.tags["mlflow.parentRunId"] for run in children} == {run.info.run_id for run in parents}


def test_the_report_of_a_sweep(outputs, sweep, capsys):
    sweep(outputs, *FACTORS)
    cli.run("report", ["sweep=sweep"])
    assert "push_pull - none" in capsys.readouterr().out
    folder = find_sweep("sweep", outputs) / "report"
    text = (folder / "report.md").read_text()
    assert "8 runs planned: " in text
    assert "**Exploratory**" in text
    assert "| lenet_b | push_pull | " in text
    names = {path.name for path in folder.iterdir()}
    assert names >= {"cells.csv", "contrasts.csv", "cells.tex", "contrasts.tex", "severity_lenet_a.png"}
    assert names >= {"contrast_push_pull-none.svg", "severity_lenet_b.svg"}
    store = open_store("sqlite", None, outputs)
    parent = read_plan(find_sweep("sweep", outputs)).mlflow_runs[-1]
    assert "report" in [file.path for file in store.client.list_artifacts(parent)]


def test_a_failing_cell_is_recorded_and_the_rest_go_on(tmp_path, sweep):
    for name in ("good", "bad"):
        for label in ("a", "b"):
            folder = tmp_path / name / label
            folder.mkdir(parents=True)
            for number in range(12):
                Image.new("L", (20, 20), 20 * number).save(folder / f"{number}.png")
    (tmp_path / "bad" / "a" / "3.png").write_bytes(b"no image")
    folders = f"dataset.folder={tmp_path / 'good'},{tmp_path / 'bad'}"
    common = [
        "dataset=image_folder",
        "dataset.size=28",
        "tracking=none",
        "trainer.max_epochs=1",
        "trainer.batch_size=8",
    ]
    status, text = sweep(tmp_path / "outputs", *common, folders, "seed=0,1")
    assert status == 1
    assert "4 planned, " in text
    assert "2 failed" in text
    assert "3.png cannot be decoded" in text.replace("\n", "")
    plan = json.loads((find_sweep("sweep", tmp_path / "outputs") / "cells.json").read_text())
    assert [bool(cell["message"]) for cell in plan["cells"]] == [False, False, True, True]
