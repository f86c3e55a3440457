import pytest
from support import Hears

from sextant.errors import UserError
from sextant.runs.sweep_directory import Cell, SweepPlan, find_sweep, read_plan, report_command


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


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"cells": [{}]}'])
def test_a_damaged_plan_is_passed_over_for_one_that_can_be_read(tmp_path, content):
    damaged = plan(digest="d2").write(tmp_path)
    (damaged / "cells.json").write_text(content)
    for reference in ("demo", damaged.name):
        with pytest.raises(UserError, match=r"cells\.json is missing or damaged"):
            read_plan(find_sweep(reference, tmp_path))
    directory, said = plan().write(tmp_path), Hears()
    assert find_sweep("demo", tmp_path, said) == directory
    assert said.said == [f"{damaged}/cells.json is missing or damaged, and is skipped"]
    assert plan(digest="d2").resumed(tmp_path) == plan(digest="d2")


def test_the_command_of_a_report_names_other_outputs_than_the_default(tmp_path, monkeypatch):
    outputs = tmp_path / "my outputs"
    directory = plan().write(outputs)
    assert report_command(directory) == f"sextant report sweep={directory.name} 'outputs={outputs}'"
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(outputs))
    assert report_command(directory) == f"sextant report sweep={directory.name}"
