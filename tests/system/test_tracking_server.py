"""Runs and sweeps that log to a real MLflow server, which goes away and loses its database."""

import shutil
import socket
import time
import urllib.request

import pytest
from support import QUICK, quick_config

from sextant import cli
from sextant.chapters.classification.task import Classification
from sextant.cli.sweep import run_sweep
from sextant.cli.terminal import TERMINAL
from sextant.composing.compose import compose, to_plain
from sextant.lifecycle.execute import execute, execute_cell
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import find_sweep, read_plan
from sextant.tracking.environment import quiet_libraries
from sextant.tracking.server import guarded, server_command
from sextant.tracking.store import open_store


class Server:
    """A server that can be stopped, with or without its database, and started again at the same address."""

    def __init__(self, folder):
        self.folder, self._running = folder, None
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.uri = f"http://127.0.0.1:{self.port}"

    def start(self):
        self.folder.mkdir(exist_ok=True)
        command = server_command(
            "127.0.0.1", self.port, f"sqlite:///{self.folder}/mlflow.db", (self.folder / "artifacts").as_uri()
        )
        self._running = guarded(command)
        process, deadline = self._running.__enter__(), time.monotonic() + 240
        while True:
            assert process.poll() is None
            assert time.monotonic() < deadline
            try:
                urllib.request.urlopen(f"{self.uri}/health", timeout=5).close()
            except OSError:
                time.sleep(0.2)
            else:
                return

    def stop(self, *, losing_everything=False):
        if self._running is not None:
            self._running.__exit__(None, None, None)
            self._running = None
        if losing_everything:
            shutil.rmtree(self.folder)

    def runs(self):
        store = open_store("server", self.uri, self.folder)
        return store.client, store.client.search_runs([store.experiment_id("classification")])


@pytest.fixture
def server(tmp_path):
    quiet_libraries()
    server = Server(tmp_path / "server")
    server.start()
    yield server
    server.stop()


def require_whole(server, *directories):
    """The server has each of these runs once, FINISHED, with its metrics, artifacts and times; returns other runs."""
    client, runs = server.runs()
    for directory in directories:
        name, state = f"{directory.path.parent.name}/{directory.path.name}", directory.state()
        (found,) = [run for run in runs if run.data.tags.get("sextant.run") == name]
        runs.remove(found)
        assert found.info.status == "FINISHED"
        assert found.info.start_time == int(1000 * state["started"])
        assert found.info.end_time == int(1000 * state["ended"])
        for metric, value in directory.results()["metrics"].items():
            assert found.data.metrics[metric] == pytest.approx(value)
        folders = ("", "figures", "checkpoints")
        artifacts = {file.path for folder in folders for file in client.list_artifacts(found.info.run_id, folder)}
        assert {"config.yaml", "metrics.json", "figures/contact_sheet.png", "checkpoints/last.ckpt"} <= artifacts
        assert state["tracking"]["sent"]
    return runs


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_run_whose_server_goes_away_gets_there(server, tmp_path, monkeypatch, capsys):
    outputs, training_step = tmp_path / "outputs", Classification.training_step
    tracking = ["tracking=server", f"tracking.uri={server.uri}"]

    def stopping_the_server(self, batch, batch_idx):
        if self.global_step == 30:
            server.stop()
        return training_step(self, batch, batch_idx)

    with monkeypatch.context() as patch:
        patch.setattr(Classification, "training_step", stopping_the_server)
        first = RunDirectory(execute(quick_config(outputs, *tracking), reporter=TERMINAL).directory)
    command = f"sextant dashboard tracking=server tracking.uri={server.uri}"
    assert command in capsys.readouterr().out.replace("\n", " ")

    server.start()
    assert [run.info.status for run in server.runs()[1]] == ["RUNNING"]
    cli.run("dashboard", [*command.split()[2:], f"outputs={outputs}"])
    assert require_whole(server, first) == []

    server.stop(losing_everything=True)
    server.start()
    second = RunDirectory(execute(quick_config(outputs, *tracking, "seed=1")).directory)
    assert require_whole(server, first, second) == []


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_sweep_whose_server_loses_its_database_gets_there(server, tmp_path):
    outputs = tmp_path / "outputs"
    tracking = [*QUICK, "tracking=server", f"tracking.uri={server.uri}", f"paths.outputs={outputs}"]

    def launch(jobs):
        outcomes = []
        for number, job in enumerate(jobs):
            if number == 1:  # of three: the second finds no server, and the third a new one
                server.stop(losing_everything=True)
            if number == 2:
                server.start()
            outcomes.append(execute_cell(to_plain(compose(job.overrides))))
        return outcomes

    run_sweep([*tracking, "seed=0,1,2"], run_cells=launch)
    plan = read_plan(find_sweep("sweep", outputs))
    directories = [RunDirectory(outputs / cell.run) for cell in plan.cells]
    (parent,) = require_whole(server, *directories)
    assert parent.info.run_id == plan.mlflow_runs[-1]
    assert (parent.info.status, parent.data.tags["sextant.outcome"]) == ("FAILED", "3 diverged")  # as short as they are
    assert (parent.info.start_time, parent.info.end_time) == (int(1000 * plan.began), int(1000 * plan.ended))
    children = [run for run in server.runs()[1] if run.info.run_id != parent.info.run_id]
    assert {run.data.tags["mlflow.parentRunId"] for run in children} == {parent.info.run_id}
