import pytest

from sextant.errors import UserError
from sextant.runs.sweep_directory import Cell, SweepPlan, find_sweep, read_plan


def plan(name="demo", digest="d1"):
    return SweepPlan(name, {"name": name}, ["sweep=demo"], [Cell({"backbone": "a"}, "conv", 0, 0, digest, "runs/x")])


def test_round_trip(tmp_path):
    assert read_plan(plan().write(tmp_path)) == plan()


def test_another_experiment_is_another_directory_and_moved_runs_are_not(tmp_path):
    assert plan(digest="d2").directory(tmp_path) != plan().directory(tmp_path)
    moved = SweepPlan("demo", {}, [], [Cell({"backbone": "a"}, "conv", 0, 0, "d1", "runs/y-2", message="failed")])
    assert moved.directory(tmp_path) == plan().directory(tmp_path)


def test_found_by_name_directory_or_parent_run(tmp_path):
    directory = SweepPlan(**{**plan().__dict__, "mlflow_runs": ["run1"]}).write(tmp_path)
    assert find_sweep("demo", tmp_path) == find_sweep(str(directory), tmp_path) == directory
    assert find_sweep(directory.name, tmp_path) == find_sweep("run1", tmp_path) == directory


def test_an_unknown_sweep_is_told_with_those_there_are(tmp_path):
    plan().write(tmp_path)
    with pytest.raises(UserError, match="Sweeps here: demo"):
        find_sweep("dmeo", tmp_path)


def test_a_damaged_plan_is_named(tmp_path):
    directory = plan().write(tmp_path)
    (directory / "cells.json").write_text("{")
    with pytest.raises(UserError, match=r"cells\.json is missing or damaged"):
        read_plan(directory)
