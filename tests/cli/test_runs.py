"""``sextant runs``: what was run, when, for which arm of which sweep, and how well it did."""

import pytest

from sextant.atomic_files import write_json
from sextant.cli import runs
from sextant.console import console
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan


@pytest.fixture
def two_runs(tmp_path, monkeypatch):
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    monkeypatch.setattr(console.console, "_width", 300)
    done, begun = (RunDirectory(tmp_path / "runs" / "classification" / name) for name in ("aaaaaaaa-s0", "bbbbbbbb-s1"))
    params = {"dataset._target_": "sextant.data.digits.Digits", "backbone._target_": "sextant.models.LeNet"}
    done.update_state({"started": 1_700_000_000.0, "params": params, "mlflow_runs": ["0123"]})
    write_json(done.metrics, {"outcome": "finished", "metrics": {"val/accuracy": 0.5, "test/accuracy/clean": 0.9876}})
    begun.update_state({"started": 1_700_000_000.0, "params": params})
    cell = Cell({"backbone": "lenet_a"}, "push_pull", 0, 0, "a" * 64, "runs/classification/aaaaaaaa-s0")
    SweepPlan("demo", {}, [], [cell]).write(tmp_path)


def test_runs_are_listed_with_date_arm_and_metric(two_runs, capsys):
    runs.main([])
    said = " ".join(capsys.readouterr().out.split())
    for word in ("classification/aaaaaaaa-s0", "finished", "2023-11-1", "demo: push_pull", "test/accuracy/clean 0.9876",
                 "Digits, LeNet", "0123", "classification/bbbbbbbb-s1", "unfinished"):  # fmt: skip
        assert word in said


@pytest.mark.parametrize("width", [80, 120])
def test_the_names_of_runs_are_whole(two_runs, capsys, monkeypatch, width):
    monkeypatch.setattr(console.console, "_width", width)
    runs.main([])
    said = capsys.readouterr().out
    assert "classification/aaaaaaaa-s0" in said
    assert "classification/bbbbbbbb-s1" in said
    assert "…" not in said
