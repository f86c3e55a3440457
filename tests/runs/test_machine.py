"""What ``sextant doctor`` finds on a machine."""

import pytest

from sextant import cli
from sextant.console.console import console
from sextant.runs.directory import RunDirectory
from sextant.runs.machine import DATA, machine_facts


def facts(outputs, data=None):
    return {(fact.topic, fact.name): fact for fact in machine_facts(outputs, data)}


def test_data_that_is_there_and_missing_is_told_apart(tmp_path):
    (tmp_path / "nordland").mkdir()
    found = facts(tmp_path, str(tmp_path))
    states = {name: found["data", name].state for name in DATA}
    assert states == {name: "good" if name == "nordland" else "note" for name in DATA}
    assert facts(tmp_path, str(tmp_path / "gone"))["data", "SEXTANT_DATA"].state == "bad"
    assert facts(tmp_path)["data", "SEXTANT_DATA"].state == "note"


def test_runs_that_the_store_lacks_and_a_damaged_store_are_found(tmp_path):
    run = RunDirectory(tmp_path / "runs" / "classification" / "05e71b0b-s0")
    run.path.mkdir(parents=True)
    run.update_state({"tracking": {"kind": "sqlite", "uri": None, "sent": False}})
    run.metrics.write_text('{"outcome": "finished", "metrics": {}}')
    (tmp_path / "mlflow.db").write_text("no database " * 100)
    found = facts(tmp_path)
    assert found["runs", "finished"].found == "1 of 1"
    assert found["runs", "mlflow.db"].state == "bad"
    assert "1 run is not there" in found["runs", "tracking store"].found


def test_finished_runs_that_are_in_no_store_are_counted(tmp_path):
    """As those of ``tracking=none``, until ``sextant dashboard`` notes the MLflow run that it made of each."""
    for seed in range(3):
        run = RunDirectory(tmp_path / "runs" / "classification" / f"05e71b0b-s{seed}")
        run.update_state({"tracking": None, **({"mlflow_runs": ["0" * 32]} if seed == 2 else {})})
        run.metrics.write_text('{"outcome": "finished", "metrics": {}}')
    store = facts(tmp_path)["runs", "tracking store"]
    assert (store.state, store.found) == (
        "note", f"2 runs are in no store; sextant dashboard outputs={tmp_path} adds them to one"
    )  # fmt: skip
    assert not (tmp_path / "mlflow.db").exists()


def test_the_machine_is_described(tmp_path):
    found = facts(tmp_path / "not yet")
    assert found["runs", "outputs"].state == "note"
    for name in ("processor", "GPU", "threads", "free disk, GiB"):
        assert found["machine", name].found
    assert found["versions", "torch"].found
    assert found["versions", "mlflow"].found


@pytest.mark.parametrize(("data", "status"), [(".", 0), ("gone", 1)])
def test_doctor_ends_with_a_status(data, status, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SEXTANT_DATA", str(tmp_path / data))
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    monkeypatch.setattr(console, "width", 400)  # no line is broken, however long the folder's name
    ended = 0
    try:
        cli.run("doctor", [])
    except SystemExit as end:
        ended = end.code
    assert ended == status
    assert ("is not a folder" in capsys.readouterr().out) == bool(status)
