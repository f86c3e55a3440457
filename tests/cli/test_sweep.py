"""Sweeps whose arms read several answers of the same runs."""

import re

import numpy as np
import pytest

from sextant.atomic_files import write_json
from sextant.cli.sweep import run_sweep
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.errors import UserError
from sextant.lifecycle.execute import run_digest
from sextant.lifecycle.sweep_plan import make_plan
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import find_sweep, read_plan

ARMS = {
    "filters": "{overrides: ['task.filters_per_class=3'], reads: cosfire_svm}",
    "paper": "{overrides: ['task.filters_per_class=3'], reads: full_svm}",
    "more": "{overrides: ['task.filters_per_class=4'], reads: cosfire_svm}",
}


def arguments(outputs, **arms):
    told = ", ".join(f"{name}: {arm}" for name, arm in (arms or ARMS).items())
    paths = [f"paths.outputs={outputs}", "tracking=none"]
    return ["task=cosfire", "+sweep.name=shared", f"+sweep.arms={{{told}}}", "+sweep.seeds=[0,1]", *paths]


def launcher(outputs, started, failing=()):
    """Writes what a run would leave."""

    def launch(jobs):
        outcomes = []
        for job in jobs:
            started.append(job.overrides)
            failed = any(word in job.overrides for word in failing)
            outcomes.append({"status": "failed" if failed else "finished", "message": "no" if failed else ""})
        plan = read_plan(find_sweep("shared", outputs))
        for cell in plan.cells:
            run = RunDirectory(outputs / cell.run)
            if run.results() is None and not failing:
                run.path.mkdir(parents=True, exist_ok=True)
                np.savez_compressed(run.arrays, labels=np.zeros(2))
                identity = dict.fromkeys(("digest", "seed", "code", "data"), "")
                write_json(run.metrics, {"outcome": "finished", "metrics": {}, "timing": {"fit_s": 1}} | identity)
        return outcomes

    return launch


def test_a_run_that_two_arms_read_is_started_once(tmp_path, capsys):
    started = []
    run_sweep(arguments(tmp_path), run_cells=launcher(tmp_path, started))
    chosen = [[o for o in job if o.startswith(("task.filters_per_class", "seed"))] for job in started]
    assert chosen == [[f"task.filters_per_class={n}", f"seed={seed}"] for n in (3, 4) for seed in (0, 1)]
    assert "6 cells of 4 runs planned, 0 finished already" in capsys.readouterr().out
    plan = read_plan(find_sweep("shared", tmp_path))
    runs = {arm: [cell.run for cell in plan.cells if cell.arm == arm] for arm in ARMS}
    assert runs["filters"] == runs["paper"]
    assert not set(runs["filters"]) & set(runs["more"])


def test_a_run_that_fails_fails_both_arms(tmp_path):
    with pytest.raises(SystemExit):
        run_sweep(arguments(tmp_path), run_cells=launcher(tmp_path, [], failing=["seed=1"]))
    plan = read_plan(find_sweep("shared", tmp_path))
    assert [(cell.arm, cell.pair) for cell in plan.cells if cell.message == "no"] == [(arm, 1) for arm in ARMS]


def test_a_sweep_whose_plan_is_damaged_is_planned_again(tmp_path):
    run_sweep(arguments(tmp_path), run_cells=launcher(tmp_path, []))
    directory = find_sweep("shared", tmp_path)
    cells = len(read_plan(directory).cells)
    (directory / "cells.json").write_text("{")
    run_sweep(arguments(tmp_path), run_cells=launcher(tmp_path, []))
    assert len(read_plan(directory).cells) == cells


@pytest.mark.parametrize(
    ("task", "reads", "says"),
    [
        (
            "cosfire",
            "full_smv",
            "sweep.arms.paper.reads=full_smv: its runs have the methods cosfire_svm, tiled_svm, strongest_filter",
        ),
        ("cosfire", "cosfire_tuned", "sweep.arms.paper.reads=cosfire_tuned: its runs have the methods"),
        ("classification", "network", "sweep.arms.paper.reads=network: task=classification has one method"),
    ],
)
def test_an_arm_that_reads_what_there_is_not_is_told_before_anything_runs(tmp_path, task, reads, says):
    given = arguments(tmp_path, paper=f"{{overrides: ['task.test_every=2'], reads: {reads}}}")
    given[0] = f"task={task}"
    with pytest.raises(UserError, match=re.escape(says)):
        run_sweep(given, run_cells=lambda jobs: pytest.fail("it was started"))


def test_a_group_that_is_null_is_told():
    with pytest.raises(UserError, match=re.escape("backbone=null: a group cannot be null\nLeave it out: '~backbone'")):
        compose(["task=cosfire", "task.images=20", "backbone=null"])


def test_a_value_may_follow_the_seed(tmp_path):
    arms = {"few": "{overrides: ['task.filters_per_class=3']}", "many": "{overrides: ['task.filters_per_class=4']}"}
    plan, planned, _ = make_plan([*arguments(tmp_path, **arms), "task.split_seed=${seed}"])
    assert len({cell.digest for cell in plan.cells}) == 4
    for entry in planned:
        config = validate(to_plain(compose(entry.overrides)))
        assert config.task.split_seed == config.seed
        assert run_digest(config) == entry.cell.digest
