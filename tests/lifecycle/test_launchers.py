"""Launchers without a cluster: what is refused, what would be submitted, and what becomes of tasks that vanish."""

import re
import threading

import pytest
from support import quick_config

from sextant import cli
from sextant.atomic_files import write_json
from sextant.composing.compose import compose, to_plain
from sextant.config import digest, validate
from sextant.errors import UserError
from sextant.lease import Lease, take
from sextant.lifecycle import launchers
from sextant.lifecycle.launchers import CellTask, launch, require_launcher
from sextant.lifecycle.launchers.slurm_queue import cancel_all, read_queue, submissions
from sextant.lifecycle.sweep import dry_run, run_sweep
from sextant.lifecycle.sweep_status import sweep_status
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import find_sweep

SLURM = ("launcher=slurm", "launcher.lease_s=0.3", "tracking=none")


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """Commands of a SLURM that accepts everything and has nothing in its queue, unless a file says so."""
    folder = tmp_path / "bin"
    folder.mkdir()
    commands = {
        "sbatch": f"echo x >> {folder}/submitted; echo Submitted batch job 7",
        "squeue": f"cat {folder}/queue 2>/dev/null || true",
        "scancel": f"echo $@ >> {folder}/cancelled",
        "sinfo": "echo 'main*'; echo gpu",
        "srun": "exit 1",
    }
    for name, line in commands.items():
        (folder / name).write_text(f"#!/bin/sh\n{line}\n")
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    return folder


def config(tmp_path, *overrides):
    return validate(quick_config(tmp_path, *overrides))


def cells(tmp_path, count):
    runs = [tmp_path / "runs" / "classification" / f"{number:08d}-s0" for number in range(count)]
    return [CellTask(("tracking=none",), run) for run in runs]


def finish(run):
    run.mkdir(parents=True)
    write_json(RunDirectory(run).metrics, {"outcome": "finished", "metrics": {}})


def test_a_launcher_is_no_part_of_an_experiment():
    assert len({digest(to_plain(compose([f"launcher={name}"]))) for name in ("local", "joblib", "slurm", "ray")}) == 1


@pytest.mark.parametrize(("launcher", "package"), [("slurm", "submitit"), ("ray", "ray")])
def test_a_launcher_without_its_package_is_told(tmp_path, monkeypatch, launcher, package):
    monkeypatch.setattr(
        launchers, "find_spec", lambda name: None if name == package else importlib.util.find_spec(name)
    )
    with pytest.raises(UserError, match=rf"needs {package}, .*\npip install 'sextant\[{launcher}\]'"):
        require_launcher(config(tmp_path, f"launcher={launcher}", "tracking=none"))


def test_missing_commands_of_slurm_are_one_error(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="this machine has no sbatch, squeue, scancel, sinfo, srun\n"):
        run_sweep(["seed=0,1", *SLURM, f"paths.outputs={tmp_path}"])
    assert not (tmp_path / "sweeps").exists()


def test_a_partition_that_does_not_exist_is_told(tmp_path, slurm):
    require_launcher(config(tmp_path, *SLURM, "launcher.partition=gpu"))
    with pytest.raises(UserError, match=r"launcher.partition=gup: no such partition\nPartitions: main, gpu"):
        require_launcher(config(tmp_path, *SLURM, "launcher.partition=gup"))


def test_hydras_launchers_and_single_runs_on_a_cluster_are_refused(capsys):
    for words, told in (
        (["-m", "seed=0,1", "hydra/launcher=joblib"], "launcher=joblib launcher.workers=4"),
        (["launcher=slurm"], "sextant train -m launcher=slurm"),
        (["-m", "--cfg", "job", "seed=0,1"], "prints something about one run, -m starts many"),
    ):
        with pytest.raises(SystemExit):
            cli.run("train", words)
        assert told in capsys.readouterr().err


def test_a_dry_run_prints_what_sbatch_would_get_and_writes_nothing(tmp_path, slurm, capsys):
    resources = ["launcher.partition=gpu", "launcher.gpus=1", "launcher.time_min=90", "launcher.memory_gb=1.5"]
    more = ["launcher.cells_per_task=2", "launcher.at_once=2", "+launcher.options.constraint=a100"]
    outputs = tmp_path / "outputs"
    cli.run("train", ["-m", "--dry-run", "seed=0,1,2,3,4", f"paths.outputs={outputs}", *SLURM, *resources, *more])
    text = capsys.readouterr().out
    assert "5 runs are missing" in text
    assert len(re.findall(r"^classification/\w{8}-s\d  ", text, re.MULTILINE)) == 5
    for line in (
        "array=0-2%2",
        "partition=gpu",
        "gpus-per-node=1",
        "time=90",
        "mem=1536MB",
        "constraint=a100",
        "requeue",
    ):
        assert f"#SBATCH --{line}" in text
    assert list(outputs.iterdir()) == []
    assert not (slurm / "submitted").exists()
    assert dry_run(["seed=0,1", "launcher=local", f"paths.outputs={outputs}"])[1] == ""


def test_tasks_that_vanish_are_submitted_again_and_then_given_up(tmp_path, slurm):
    (good, bad), folder = cells(tmp_path, 2), tmp_path / "sweeps" / "one"
    finish(good.run)
    outcomes = launch([good, bad], config(tmp_path, *SLURM, "launcher.attempts=2"), folder)
    assert [outcome["status"] for outcome in outcomes] == ["finished", "failed"]
    assert (
        f"its task ended 2 times without a word; no log was written: do all nodes share {folder}?"
        in outcomes[1]["message"]
    )
    assert [submission.tasks for submission in submissions(folder)] == [[[good.name], [bad.name]], [[bad.name]]]


def test_what_waits_in_the_queue_is_not_submitted_again_and_what_is_cancelled_ends(tmp_path, slurm):
    both, folder = cells(tmp_path, 2), tmp_path / "sweeps" / "one"
    assert launch(both, config(tmp_path, *SLURM, "launcher.wait=false"), folder) == [None, None]
    (submission,) = submissions(folder)
    (slurm / "queue").write_text(f"{submission.name}|1|7|PENDING|(Resources)\n{submission.name}|0|7|COMPLETING|n1\n")
    assert read_queue()[submission.name, 1].job == "7_1"
    assert launch(both, config(tmp_path, *SLURM, "launcher.wait=false"), folder) == [None, None]
    assert [submission.tasks for submission in submissions(folder)] == [[[c.name] for c in both], [[both[0].name]]]
    assert cancel_all(folder) == 1
    assert (slurm / "cancelled").read_text() == "7_1\n"


def test_the_task_of_a_node_that_is_silent_is_cancelled_and_submitted_elsewhere(tmp_path, slurm, monkeypatch):
    (cell,), folder = cells(tmp_path, 1), tmp_path / "sweeps" / "one"
    place = cell.run.parent / ".locks" / cell.run.name
    with monkeypatch.context() as patch:  # a process of another host, which has died with it
        patch.setattr("sextant.lease._place", lambda: "another host")
        lease = take(place, 0.01)
        lease._released.set()
    waiting = threading.Thread(
        target=launch, args=([cell], config(tmp_path, *SLURM, "launcher.attempts=3"), folder), daemon=True
    )
    waiting.start()
    while not (slurm / "submitted").exists():
        waiting.join(0.01)
    (submission,) = submissions(folder)
    (slurm / "queue").write_text(f"{submission.name}|N/A|7|RUNNING|n1\n")
    while len(submissions(folder)) < 2:
        waiting.join(0.01)
        assert waiting.is_alive()
    assert "7" in (slurm / "cancelled").read_text().split()
    taken = take(place)
    assert isinstance(taken, Lease)
    taken.release()
    finish(cell.run)
    waiting.join(30)
    assert not waiting.is_alive()


def test_the_status_of_a_sweep_says_what_each_run_is_at(tmp_path):
    given = ["seed=0,1,2,3", "tracking=none", f"paths.outputs={tmp_path}"]

    def run_cells(jobs):
        finish(jobs[0].run)
        jobs[1].run.mkdir(parents=True)
        RunDirectory(jobs[1].run).update_state({"failure": "UserError: broken"})
        lease = take(jobs[2].run.parent / ".locks" / jobs[2].run.name)
        states, controller = sweep_status(find_sweep("sweep", tmp_path))
        assert [state.state for state in states] == ["finished", "failed", "running", "missing"]
        assert states[1].where == "UserError: broken"
        assert states[2].where.startswith("process ")
        assert controller.here
        lease.release()
        return [{"status": "finished", "message": ""}] * 4

    run_sweep(given, run_cells=run_cells)
    states, controller = sweep_status(find_sweep("sweep", tmp_path))
    assert [state.state for state in states] == ["finished", "failed", "missing", "missing"]
    assert controller is None
