"""One sweep with every launcher, and on a cluster whose tasks, node and controller are killed."""

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from loopback_slurm import running_slurm
from support import CHECKPOINT, QUICK, wait_for

from sextant.lifecycle.launchers.slurm_queue import submissions
from sextant.runs.directory import all_runs
from sextant.runs.history import read_history
from sextant.runs.sweep_directory import find_sweep

pytestmark = [pytest.mark.cluster, pytest.mark.slow, pytest.mark.timeout(1800)]
ROOT = Path(__file__).parents[2]
SWEEP = [*QUICK, "trainer.max_epochs=8", "tracking=none", "inhibition=none,push_pull", "seed=0,1"]
TABLES = ("cells.csv", "contrasts.csv", "seeds.csv")


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    with running_slurm(tmp_path_factory.mktemp("slurm")) as running:
        yield running


@pytest.fixture(scope="module")
def ray_cluster():
    """A Ray of two workers."""
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    cluster.add_node(num_cpus=1)
    yield cluster
    cluster.shutdown()


def start(outputs, *overrides, environment=None, program=("train.py", "-m")):
    command = [sys.executable, *program, *overrides]
    full = {**os.environ, "SEXTANT_OUTPUTS": str(outputs), "PYTHONPATH": str(ROOT / "src"), **(environment or {})}
    return subprocess.Popen(
        command,
        cwd=ROOT,
        env=full,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def run(outputs, *overrides, environment=None, program=("train.py", "-m")):
    process = start(outputs, *overrides, environment=environment, program=program)
    text, _ = process.communicate()
    assert process.returncode == 0, text
    return text


def ask(outputs, verb, slurm):
    return run(
        outputs,
        verb,
        "sweep",
        environment=slurm.environment,
        program=("-c", "from sextant.cli import main; main()", "sweep"),
    )


def found(outputs):
    """What each run found, by its config and seed; each has one directory, and no step twice in its history."""
    results = {}
    for directory in all_runs(outputs):
        result = directory.results()
        key = result["digest"], result["seed"]
        assert key not in results
        results[key] = result["metrics"]
        steps = [(line["step"], name) for line in read_history(directory.history) for name in line["metrics"]]
        assert len(steps) == len(set(steps))
    return results


def tables(outputs):
    run(outputs, "sweep=sweep", program=("report.py",))
    return {name: (find_sweep("sweep", outputs) / "report" / name).read_bytes() for name in TABLES}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    outputs = tmp_path_factory.mktemp("local")
    run(outputs, *SWEEP, "launcher=local")
    return found(outputs), tables(outputs)


def test_joblib_gives_the_same_tables(expected, tmp_path):
    run(tmp_path, *SWEEP, "launcher=joblib", "launcher.workers=2")
    assert (found(tmp_path), tables(tmp_path)) == expected


def test_ray_gives_the_same_tables(expected, tmp_path, ray_cluster):
    run(tmp_path, *SWEEP, "launcher=ray", f"launcher.address={ray_cluster.address}")
    assert (found(tmp_path), tables(tmp_path)) == expected


def test_slurm_gives_the_same_tables_submitted_left_and_attached(expected, tmp_path, slurm):
    told = run(tmp_path, *SWEEP, "launcher=slurm", "launcher.wait=false", environment=slurm.environment)
    assert "4 submitted" in told
    again = run(tmp_path, *SWEEP, "launcher=slurm", "launcher.wait=false", environment=slurm.environment)
    assert "4 submitted" in again
    directory = find_sweep("sweep", tmp_path)
    assert [len(submission.tasks) for submission in submissions(directory)] == [4]  # nothing was submitted twice
    status = ask(tmp_path, "status", slurm)
    assert "queued" in status or "running" in status
    assert "no process is waiting for it" in status
    assert "4 planned" in ask(tmp_path, "attach", slurm)
    assert (found(tmp_path), tables(tmp_path)) == expected
    nodes = {
        line.split("hostname")[0] for file in directory.glob("slurm/*/*.out") for line in file.read_text().splitlines()
    }
    assert nodes


def test_what_is_cancelled_is_not_submitted_again_until_asked_for(expected, tmp_path, slurm):
    waiting = start(tmp_path, *SWEEP, "launcher=slurm", "launcher.lease_s=6", environment=slurm.environment)
    wait_for(tmp_path, "sweeps/*/slurm/*/*_submitted.pkl", lambda: waiting.poll() is not None)
    assert "tasks cancelled" in ask(tmp_path, "cancel", slurm)
    text, _ = waiting.communicate()
    assert waiting.returncode in (1, 130)  # it was interrupted, or saw first that its tasks were cancelled
    assert "cancelled" in text
    run(tmp_path, *SWEEP, "launcher=slurm", "launcher.cells_per_task=2", environment=slurm.environment)
    assert (found(tmp_path), tables(tmp_path)) == expected


def test_ten_preemptions_a_dead_node_and_two_dead_controllers_change_nothing(tmp_path, slurm):
    """The process that waits is killed twice, and SLURM's own controller is started anew twice."""
    sweep = [*QUICK, "tracking=none", "inhibition=none,push_pull", "seed=0,1,2", "trainer.max_epochs=40"]
    whole, outputs = tmp_path / "whole", tmp_path / "killed"
    run(whole, *sweep, "launcher=joblib", "launcher.workers=2")
    cluster = ["launcher=slurm", "launcher.lease_s=12", "launcher.attempts=50"]
    controller = start(outputs, *sweep, *cluster, environment=slurm.environment)
    rng, preempted = random.Random(0), 0
    while preempted < 10:
        slurm.hurry()
        wait_for(outputs, CHECKPOINT, lambda p=controller: p.poll() is not None)
        assert controller.poll() is None
        running = slurm.ask("squeue", "--noheader", "--array", "--states=RUNNING", "--format=%i").split()
        if not running:
            continue
        job = rng.choice(running)
        how = [["scontrol", "requeue", job], ["scancel", "--signal=KILL", job], ["scancel", "--signal=TERM", job]]
        slurm.ask(*how[preempted % 3], check=False)  # it may have ended in this moment
        preempted += 1
        if preempted in (3, 8):
            os.kill(controller.pid, signal.SIGKILL)
            controller.communicate()
            controller = start(outputs, *sweep, *cluster, environment=slurm.environment)
        if preempted in (2, 7):
            slurm.restart_controller()
        if preempted == 5:
            slurm.kill("n2")
        if preempted == 9:
            slurm.start_node("n2")
    slurm.hurry()
    text, _ = controller.communicate()
    assert controller.returncode == 0, text
    assert len(submissions(find_sweep("sweep", outputs))) > 1  # what was killed for good was submitted again
    assert found(outputs) == found(whole)
    assert len(found(outputs)) == 6
    assert tables(outputs) == tables(whole)
