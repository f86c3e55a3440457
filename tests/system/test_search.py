"""A search of real runs that is killed with signal 9 ends as if it had not been."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from sextant import cli
from sextant.lifecycle.results import sweep_results
from sextant.reports.search_results import search_results
from sextant.runs.directory import all_runs
from sextant.runs.sweep_directory import find_sweep, read_plan
from sextant.tracking.store import open_store

ROOT = Path(__file__).parents[2]
KILLS = 3
TRACES = ("runs/*/*/run.json", "runs/*/*/checkpoints/last.ckpt", "runs/*/*/metrics.json")
SEARCH = [
    *("-m", "sweep.search=tpe", "sweep.search.n_trials=5", "seed=0,1", "corruption=none"),
    *("optimizer.lr=log_uniform(0.05, 0.5)", "optimizer.momentum=uniform(0.5, 0.95)"),
]


def words_of(outputs):
    return [
        *SEARCH,
        "trainer.max_epochs=4",
        "trainer.batch_size=32",
        "trainer.progress=false",
        "tracking.system_metrics=false",
        f"paths.outputs={outputs}",
    ]


def started(outputs):
    return subprocess.Popen([sys.executable, "train.py", *words_of(outputs)], cwd=ROOT, stdout=subprocess.DEVNULL)


def traces(outputs):
    return sum(1 for pattern in TRACES for _ in outputs.glob(pattern))


def found_in(outputs):
    found = search_results(sweep_results("search", outputs))
    return [(t.setting, t.values, t.tested, t.state) for t in found.trials], found.winner.number, found.fresh


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_a_search_killed_three_times_finds_what_it_would_have_found(tmp_path, monkeypatch):
    """Once at each moment; searches of every kind are killed more often in tests/lifecycle/test_search.py."""
    monkeypatch.setattr(sys, "argv", ["train.py"])
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    for number in range(KILLS):
        process, before = started(killed), traces(killed)
        while traces(killed) < before + 1 + number % 3 and process.poll() is None:  # in turn: begun, trained, finished
            time.sleep(0.01)
        assert process.poll() is None
        process.kill()
        process.wait()
    assert started(killed).wait() == 0
    cli.run("train", words_of(whole))
    assert found_in(killed) == found_in(whole)
    assert len(found_in(whole)[0]) == 5
    plan = read_plan(find_sweep("search", killed))
    assert {run.path.relative_to(killed).as_posix() for run in all_runs(killed)} == {cell.run for cell in plan.cells}
    store = open_store("sqlite", None, killed)
    runs = store.client.search_runs([store.experiment_id("classification")])
    assert {run.info.status for run in runs} == {"FINISHED"}
    parents = [run for run in runs if "sextant.sweep" in run.data.tags]
    assert [run.info.run_id for run in parents] == plan.mlflow_runs
    assert len(runs) == len(plan.cells) + 1
