"""kill -9 at any moment loses nothing and doubles nothing."""

import multiprocessing
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from support import CHECKPOINT, QUICK, heeds_signals, quick_config, wait_for

from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory, all_runs
from sextant.tracking.store import open_store

ROOT = Path(__file__).parents[2]
KILLS = 10
#: what a child needs, so that it begins to train at once
PRELOADED = [
    *("sextant.lifecycle.training", "sextant.chapters.classification.chapter", "sextant.tracking.mirror"),
    *("mlflow.store.tracking.sqlalchemy_store", "matplotlib.pyplot", "pygments"),
]
HAS_BEGUN_A_RUN = 200e6  # bytes: it has imported torch. A worker without a task yet is joblib's and idles on.


def child(raw):
    os.setsid()
    execute(raw, wait=True)


def intact(outputs):
    with sqlite3.connect(outputs / "mlflow.db") as connection:
        return connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def tracked(outputs):
    store = open_store("sqlite", None, outputs)
    return store.client.search_runs([store.experiment_id("classification")])


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_run_killed_ten_times_ends_as_if_it_had_not_been(tmp_path):
    overrides = ["trainer.max_epochs=24", "trainer.batch_size=32"]
    raw = quick_config(tmp_path / "killed", *overrides)
    expected = RunDirectory(execute(quick_config(tmp_path / "whole", *overrides)).directory).results()
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    rng = random.Random(0)
    for number in range(KILLS):
        process = context.Process(target=child, args=(raw,))
        process.start()
        if number % 3:  # twice while it trains or writes, and then while it starts
            wait_for(tmp_path / "killed", CHECKPOINT, lambda p=process: not p.is_alive())
        process.join(rng.uniform(0, 0.2))
        assert process.is_alive()
        os.kill(process.pid, signal.SIGKILL)
        process.join()
    results = RunDirectory(execute(raw).directory).results()
    assert results["metrics"] == expected["metrics"]
    assert len(all_runs(tmp_path / "killed")) == 1
    assert [run.info.status for run in tracked(tmp_path / "killed")] == ["FINISHED"]
    assert intact(tmp_path / "killed")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_sweep_of_two_workers_killed_again_and_again_ends_as_if_it_had_not_been(tmp_path):
    outputs, whole = tmp_path / "killed", tmp_path / "whole"
    choices = [(f"inhibition={kind}", f"seed={seed}") for kind in ("none", "push_pull") for seed in (0, 1)]
    epochs = "trainer.max_epochs=20"
    expected = {}
    for choice in choices:
        results = RunDirectory(execute(quick_config(whole, epochs, "tracking=none", *choice)).directory).results()
        expected[results["digest"], results["seed"]] = results["metrics"]
    command = [sys.executable, "train.py", "-m", *QUICK, epochs, "inhibition=none,push_pull", "seed=0,1"]
    command += ["launcher=joblib", "launcher.workers=2"]
    environment = {**os.environ, "SEXTANT_OUTPUTS": str(outputs)}
    rng, workers = random.Random(1), []
    # begun, and where a worker goes from one run to the next
    for number, moment in enumerate([CHECKPOINT, "runs/*/*/metrics.json"]):
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, start_new_session=True, stdout=subprocess.DEVNULL
        )
        wait_for(outputs, moment, lambda p=process: p.poll() is not None)
        time.sleep(rng.uniform(0, 1))
        assert process.poll() is None
        workers += psutil.Process(process.pid).children(recursive=True)
        os.kill(process.pid, signal.SIGKILL) if number % 2 else os.killpg(process.pid, signal.SIGKILL)
        process.wait()  # the second time the workers are left to notice by themselves
    left = psutil.wait_procs(workers, timeout=30)[1]
    assert not [worker for worker in left if worker.memory_info().rss > HAS_BEGUN_A_RUN]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = {}
    for directory in all_runs(outputs):
        results = directory.results()
        found[results["digest"], results["seed"]] = results["metrics"]
    assert found == expected
    assert len(all_runs(outputs)) == 4
    runs = tracked(outputs)
    assert sorted("sextant.sweep" in run.data.tags for run in runs) == [False] * 4 + [True]
    assert {run.info.status for run in runs} == {"FINISHED"}
    assert intact(outputs)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_ctrl_c_ends_a_run_as_killed_and_the_same_command_resumes_it(tmp_path):
    command = [sys.executable, "train.py", *QUICK, "trainer.max_epochs=40", "trainer.progress=true"]
    environment = {**os.environ, "SEXTANT_OUTPUTS": str(tmp_path)}
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=heeds_signals,
    )
    deadline = time.monotonic() + 300
    while not list(tmp_path.glob("runs/*/*/checkpoints/last.ckpt")) and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    text, _ = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "Traceback" not in text
    assert [run.info.status for run in tracked(tmp_path)] == ["KILLED"]
    (directory,) = all_runs(tmp_path)
    assert directory.results() is None
    again = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert "resuming from" in again.stdout
    assert "💡" not in again.stdout + again.stderr
    assert "test/accuracy/clean" in again.stdout
    assert directory.results()["epochs"] == 40
    assert [run.info.status for run in tracked(tmp_path)] == ["FINISHED"]
