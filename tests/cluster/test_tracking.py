"""Sixteen writers on an MLflow server on PostgreSQL, started as compose.yaml does, that is killed while they write."""

import multiprocessing
import os
import shlex
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import psutil
import pytest
import yaml
from loopback_postgres import free_port, running_postgres
from support import quick_config

from sextant.atomic_files import write_json
from sextant.config import validate
from sextant.errors import UserError
from sextant.lifecycle.execute import run_once
from sextant.lifecycle.launchers import require_store
from sextant.runs.directory import RunDirectory, RunKey, all_runs
from sextant.tracking.environment import quiet_libraries
from sextant.tracking.logger import RunLogger
from sextant.tracking.refill import refill
from sextant.tracking.store import open_store

pytestmark = pytest.mark.timeout(900)
ROOT = Path(__file__).parents[2]
WRITERS, STEPS = 16, 400


class Server:
    """The server of compose.yaml, with a database and a folder of this machine."""

    def __init__(self, database, artifacts):
        service = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]["mlflow"]
        text, self.environment = service["command"][-1].partition("exec ")[2], {**os.environ, **service["environment"]}
        password, hosts, self.port = "${MLFLOW_PASSWORD:-mlflow}", "${MLFLOW_HOSTS:-*}", free_port()
        assert password in text
        assert hosts in text
        text = text.replace(f"postgresql+psycopg2://mlflow:{password}@database:5432/mlflow", database).replace(
            hosts, "'*'"
        )
        text = text.replace("--host 0.0.0.0 --port 5000", f"--host 127.0.0.1 --port {self.port}")
        self.command = [sys.executable, "-m", *shlex.split(text.replace(" /artifacts", f" {artifacts}"))]
        self.uri, self.log = f"http://127.0.0.1:{self.port}", artifacts.with_suffix(".log")

    def start(self):
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                self.command, stdout=log, stderr=log, cwd=self.log.parent, env=self.environment
            )
        deadline = time.monotonic() + 240
        while not self.answers():
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline
            time.sleep(0.2)

    def answers(self):
        try:
            urllib.request.urlopen(f"{self.uri}/health", timeout=5).close()
        except OSError:
            return False
        return True

    def kill(self):
        if self.process.poll() is None:
            workers = psutil.Process(self.process.pid).children(recursive=True)
            for process in (self.process, *workers):
                process.kill()
            psutil.wait_procs(workers)
            self.process.wait()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("server")
    with running_postgres(folder / "postgres") as database:
        server = Server(database, folder / "artifacts")
        server.start()
        yield server
        server.kill()


def write(raw, number, go_on):
    """A run that only writes metrics; it waits half way and before its end, until it may go on."""
    quiet_libraries()
    config = validate(raw)
    key = RunKey("classification", f"{number:08d}" + 56 * "0", 0, "code", "data")

    def work(directory, open_mirror):
        logger = RunLogger(directory, open_mirror())
        for step in range(STEPS):
            if step in (STEPS // 2, STEPS - 1):
                go_on[step == STEPS - 1].wait(300)
            logger.log_metrics({"loss": number + step / STEPS, "accuracy": float(step)}, step)
            time.sleep(0.01)
        results = {"outcome": "finished", "metrics": {"test/score": float(number)}, "steps": STEPS}
        write_json(directory.metrics, results | {"digest": key.digest, "seed": 0, "code": "code", "data": "data"})
        return results

    run_once(key, config, work, lambda: None)


def write_sixteen(outputs, server, between):
    """Sixteen processes write at once; ``between`` is called when all have written half, and when nearly all."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["sextant.tracking.logger", "sextant.tracking.refill", "mlflow", __name__])
    tracking = ["tracking=server", f"tracking.uri={server.uri}", f"tracking.experiment={outputs.parent.name}"]
    raw = quick_config(outputs, *tracking)
    go_on = [context.Event(), context.Event()]
    processes = [context.Process(target=write, args=(raw, number, go_on), daemon=True) for number in range(WRITERS)]
    for process in processes:
        process.start()
    for event, lines in zip(go_on, (STEPS // 2, STEPS - 1), strict=True):
        written = outputs / "runs" / "classification"
        deadline = time.monotonic() + 300
        while sum(text.read_bytes().count(b"\n") >= lines for text in written.glob("*/history.jsonl")) < WRITERS:
            assert time.monotonic() < deadline
            assert all(process.is_alive() for process in processes)
            time.sleep(0.1)
        between()
        event.set()
    for process in processes:
        process.join()
        assert process.exitcode == 0


def require_all(outputs, server):
    store = open_store("server", server.uri, outputs)
    runs = store.client.search_runs([store.experiment_id(outputs.parent.name)], max_results=100)
    assert len(all_runs(outputs)) == len(runs) == WRITERS
    found = {run.data.tags["sextant.run"]: run for run in runs}
    assert len(found) == WRITERS
    for number in range(WRITERS):
        run = found[f"classification/{number:08d}-s0"]
        assert run.info.status == "FINISHED"
        assert run.data.metrics["test/score"] == number
        points = store.client.get_metric_history(run.info.run_id, "loss")
        assert sorted(point.step for point in points) == list(range(STEPS))
        assert all(point.value == pytest.approx(number + point.step / STEPS) for point in points)
        assert {"config.yaml", "metrics.json"} <= {file.path for file in store.client.list_artifacts(run.info.run_id)}


@pytest.mark.cluster
@pytest.mark.slow
def test_sixteen_writers_lose_nothing(server, tmp_path):
    outputs = tmp_path / "outputs"
    write_sixteen(outputs, server, lambda: None)
    require_all(outputs, server)


@pytest.mark.cluster
@pytest.mark.slow
def test_a_server_that_is_killed_twice_has_everything_in_the_end(server, tmp_path):
    outputs = tmp_path / "outputs"
    killed = []

    def kill():  # once it comes back while they write; the second time they end before it does
        server.kill()
        killed.append(True)
        if len(killed) == 1:
            server.start()

    write_sixteen(outputs, server, kill)
    assert not all(RunDirectory(run.path).state()["tracking"]["sent"] for run in all_runs(outputs))
    server.start()
    refill(open_store("server", server.uri, outputs), outputs)
    require_all(outputs, server)


@pytest.mark.parametrize("launcher", [["launcher=slurm"], ["launcher=ray", "launcher.address=auto"]])
def test_an_embedded_store_across_hosts_is_refused_with_the_remedy(launcher, tmp_path):
    with pytest.raises(UserError, match=r"tracking=sqlite: hosts cannot share an sqlite database(.|\n)*compose up"):
        require_store(validate(quick_config(tmp_path, *launcher)))


def test_the_page_tells_the_command_of_compose_yaml():
    page = (ROOT / "docs" / "clusters.md").read_text().replace("\\\n", " ")
    told = next(shlex.split(line) for line in page.splitlines() if line.startswith("mlflow server"))
    compose = yaml.safe_load((ROOT / "compose.yaml").read_text())
    run = shlex.split(compose["services"]["mlflow"]["command"][-1].partition("exec ")[2])
    options = [word for word in run if word.startswith("--")]
    assert options == [word for word in told if word.startswith("--")]
    for option in ("--host", "--port", "--workers", "--artifacts-destination"):
        assert told[told.index(option) + 1] == run[run.index(option) + 1]
