"""A training in a folder whose name means something to an address, a query, a pattern and a shell, up to its report.

A run costs seconds, so one name has the boundaries of its kind together: an escape, blanks, the beginnings of a query
and of a fragment, a letter in decomposed form, a quote. Each by itself: tests/test_addresses.py and
tests/tracking/test_store.py.
"""

import pytest
from support import QUICK

from sextant import cli

NAME = "a%20b ? c#1 cafe\u0301 it's"
SWEEP = ("-m", "seed=0", "inhibition=none,push_pull", "trainer=fast", *QUICK, "trainer.batch_size=8")


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Run a command in that folder; returns what it printed, without the breaks of lines at the width of a terminal."""
    (tmp_path / NAME).mkdir()
    monkeypatch.chdir(tmp_path / NAME)
    monkeypatch.setenv("SEXTANT_OUTPUTS", "outputs")

    def run(verb, *arguments):
        cli.run(verb, list(arguments))
        found = capsys.readouterr()
        assert not found.err
        return " ".join(found.out.split())

    return run


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_sweep_is_trained_evaluated_checked_stored_and_reported(said, tmp_path):
    outputs = tmp_path / NAME / "outputs"
    assert "2 planned, 2 finished, 0 diverged, 0 failed" in said("train", *SWEEP)
    runs = sorted(path.parent for path in outputs.glob("runs/classification/*/metrics.json"))
    assert len(runs) == 2
    assert "test/accuracy/clean" in said("evaluate", f"run={runs[0]}", "corruption=none", "tracking=none")
    checks = said("doctor")
    for sound in ("finished 3 of 3 good", "mlflow.db sound good", "1 run is in no store"):
        assert sound in checks
    assert said("dashboard", "serve=false").endswith("1 run brought up to date")
    assert "tracking store has every finished run good" in said("doctor")
    assert "2 finished" in said("report", "sweep=sweep")
    assert len(list(outputs.glob("sweeps/*/report/report.md"))) == 1
    assert [path.name for path in tmp_path.iterdir()] == [NAME]
    assert [path.name for path in (tmp_path / NAME).iterdir()] == ["outputs"]
    found = {path.name for path in outputs.iterdir() if not path.name.startswith((".", "mlflow.db-"))}
    assert found <= {"artifacts", "data", "mlflow.db", "runs", "sweeps"}
